//! What do the online models say of looks that come one after the other?

use fremen::Time;
use fremen::online::{OnlineConfig, OnlineModel};

/// Hourly stays of ten looks for `days` days; state 0 is 1 from 8 to 16 h, state 1 never.
fn taught(name: &str, days: i64) -> Box<dyn OnlineModel> {
    let cfg: OnlineConfig = name.parse().unwrap();
    let mut model = cfg.build(2);
    for day in 0..days {
        for hour in 0..24 {
            for minute in 0..10 {
                let time = Time::from_s(day * 86_400 + hour * 3_600 + minute * 60);
                model.observe(time, &[(8..16).contains(&hour), false]);
            }
        }
        model.learn().unwrap();
    }
    model
}

fn usual(model: &dyn OnlineModel, time: Time) -> [f64; 2] {
    let mut p = [f64::NAN; 2];
    model.usual_into(time, &mut p);
    p
}

#[test]
fn nothing_known_is_one_half_for_every_model_and_no_memory() {
    for name in OnlineConfig::names() {
        let mut model = name.parse::<OnlineConfig>().unwrap().build(2);
        model.learn().unwrap();
        let mut p = [0.0; 2];
        model.predict_into(Time::from_s(5), &mut p);
        assert_eq!(p, [0.5; 2], "{name}");
        assert_eq!(model.last_look(), None, "{name}");
    }
}

#[test]
fn the_rhythm_of_a_day_is_learnt_by_those_that_can() {
    let noon = Time::from_s(30 * 86_400 + 12 * 3_600);
    let night = Time::from_s(30 * 86_400 + 3_600);
    for name in [
        "fremen",
        "gaussians",
        "natural",
        "histogram",
        "histogram-persistent",
    ] {
        let model = taught(name, 21);
        let (day, dark) = (usual(&*model, noon), usual(&*model, night));
        // Five of six minutes are never looked at: the mixture is of the mean there.
        let least = if name == "gaussians" { 0.2 } else { 0.5 };
        assert!(day[0] > dark[0] + least, "{name}: {day:?} {dark:?}");
        assert!(day[1] < 0.1 && dark[1] < 0.1, "{name}: {day:?} {dark:?}");
    }
    for name in ["short-term", "long-term"] {
        let model = taught(name, 21);
        let (day, dark) = (usual(&*model, noon), usual(&*model, night));
        assert!(
            (day[0] - 1.0 / 3.0).abs() < 0.02 && day == dark,
            "{name}: {day:?}"
        );
    }
}

#[test]
fn fremen_online_is_fremen_with_the_exact_balance() {
    use fremen::spectrum::{CandidatePeriods, SpectralSums};
    let candidates = CandidatePeriods::harmonic(fremen::Period::DAY, 12).unwrap();
    let mut model = OnlineConfig::fremen(candidates.clone(), 3).build(1);
    let mut sums = SpectralSums::new(candidates);
    for day in 0..10 {
        for i in 0..50_i64 {
            let time = Time::from_s(day * 86_400 + i * i * 31);
            let state = (10_000..60_000).contains(&(i * i * 31));
            model.observe(time, &[state]);
            sums.add(time, state).unwrap();
        }
        model.learn().unwrap();
    }
    let mut p = [0.0];
    let times = (0..100).map(|i| Time::from_s(20 * 86_400 + i * 864));
    let of_order = |order: usize| {
        let rhythms = sums.rhythms(order);
        times.clone().all(|time| {
            model.predict_into(time, &mut p);
            (p[0] - rhythms.p(time)).abs() < 1e-12
        })
    };
    assert_eq!((0..=3).map(of_order).filter(|same| *same).count(), 1);
}

#[test]
fn the_last_look_counts_first_and_the_hour_later() {
    let model = taught("histogram-persistent", 21);
    let last = model.last_look().unwrap();
    let soon = last.plus_us(60_000_000);
    let mut p = [0.0; 2];
    model.predict_into(soon, &mut p);
    assert!(p[0] < 0.05, "it has just been seen to be 0: {p:?}");
    let later = Time::from_s(21 * 86_400 + 12 * 3_600);
    model.predict_into(later, &mut p);
    assert!(p[0] > 0.7, "{p:?}");
    let kept: Vec<f64> = (0..40)
        .map(|i| model.kept(f64::from(1 << (i / 2))))
        .collect();
    assert!(kept.windows(2).all(|pair| pair[1] <= pair[0]), "{kept:?}");
    assert!(kept.iter().all(|kept| (0.0..=1.0).contains(kept)));
}

#[test]
fn a_coin_is_not_remembered_and_a_switch_is() {
    let tossed = |toss: u64| {
        let mut model = OnlineConfig::default().build(1);
        let mut numbers = 88_172_645_463_325_252_u64;
        let mut side = false;
        for day in 0..20 {
            for slot in 0..72_u64 {
                if slot % toss == 0 {
                    numbers ^= numbers << 13;
                    numbers ^= numbers >> 7;
                    numbers ^= numbers << 17;
                    side = numbers & 64 == 0;
                }
                model.observe(Time::from_s(day * 86_400 + slot as i64 * 1_200), &[side]);
            }
            model.learn().unwrap();
        }
        model.kept(1_200.0)
    };
    let (coin, switch) = (tossed(1), tossed(24));
    assert!(coin < 0.2 && switch > 0.8, "{coin} {switch}");
}

#[test]
fn impossible_models_are_refused() {
    let day = fremen::Period::DAY;
    assert!(OnlineConfig::histogram(day, 0, 1.0, 1.0, 1.0).is_err());
    assert!(OnlineConfig::gaussians(day, 1, 0).is_err());
    for wrong in [0.0, -1.0, f64::NAN] {
        assert!(OnlineConfig::histogram(day, 24, wrong, 1.0, 1.0).is_err());
        assert!(OnlineConfig::histogram(day, 24, 1.0, 1.0, wrong).is_err());
    }
}
