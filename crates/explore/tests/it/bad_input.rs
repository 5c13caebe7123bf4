//! What is said of what cannot be explored?

use fremen::online::OnlineConfig;
use fremen::{ErrorKind, Period, Time};
use fremen_explore::{
    Beliefs, ExploreConfig, Explored, Explorer, Recording, Share, Slots, Strategy, Worth, simulate,
};

/// One place that says this of its state.
struct Says(f64);

impl Explored for Says {
    fn num_places(&self) -> usize {
        1
    }

    fn name(&self, _place: usize) -> &'static str {
        "kitchen"
    }

    fn num_states(&self, _place: usize) -> usize {
        1
    }

    fn predict_into(&self, _place: usize, _time: Time, out: &mut [f64]) {
        out.fill(self.0);
    }

    fn looks(&self, _place: usize, _time: Time) -> f64 {
        1.0
    }
}

fn ten_minutes() -> Period {
    Period::from_us(600_000_000).unwrap()
}

#[test]
fn no_places_are_an_error_of_a_simulation_and_an_empty_plan() {
    let recording = Recording::new(vec![Time::from_s(0)]).unwrap();
    let cfg = ExploreConfig::new(Strategy::Information).unwrap();
    let error = simulate(&recording, &OnlineConfig::default(), &cfg, 1).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
    assert!(error.help().is_some());
    for strategy in Strategy::ALL {
        let cfg = ExploreConfig::new(strategy).unwrap();
        let mut explorer = Explorer::new([], &OnlineConfig::default(), cfg);
        assert_eq!(
            explorer.plan(Time::from_s(0), 144).unwrap().num_visits(),
            0,
            "{strategy}"
        );
        assert_eq!(explorer.next(0).unwrap(), None);
    }
}

#[test]
fn a_model_that_gives_no_probability_is_named() {
    let slots = Slots::new(Time::from_s(0), ten_minutes(), 3).unwrap();
    for p in [f64::NAN, -0.1, 1.1, f64::INFINITY] {
        let error = Worth::new(&Says(p), &slots).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Format, "{p}");
        assert_eq!(error.place(), Some("place `kitchen`"));
    }
    for (p, bits) in [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0)] {
        assert_eq!(Worth::new(&Says(p), &slots).unwrap().bits(0, 2), bits);
    }
}

#[test]
fn shares_slots_and_their_lengths_are_checked() {
    for share in [-0.1, 1.1, f64::NAN] {
        assert_eq!(Share::new(share).unwrap_err().kind(), ErrorKind::Config);
    }
    for length_s in [0.0, -600.0, f64::NAN, f64::INFINITY] {
        let error = Slots::of_s(Time::from_s(0), length_s, 3).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Config, "{length_s}");
    }
    for count in [0, Slots::MAX_COUNT + 1] {
        assert!(Slots::new(Time::from_s(0), ten_minutes(), count).is_err());
    }
    assert!(Slots::new(Time::from_us(i64::MAX - 5), ten_minutes(), 1).is_err());
}

#[test]
fn recordings_are_checked() {
    assert!(Recording::new(Vec::new()).is_err());
    let twice = vec![Time::from_s(1), Time::from_s(1)];
    assert_eq!(Recording::new(twice).unwrap_err().kind(), ErrorKind::Time);
    let mut recording = Recording::new(vec![Time::from_s(0), Time::from_s(60)]).unwrap();
    assert_eq!(
        recording.push("a", 1, vec![true]).unwrap_err().kind(),
        ErrorKind::Shape
    );
    assert_eq!(
        recording.push("a", 0, vec![]).unwrap_err().kind(),
        ErrorKind::Shape
    );
    recording.push("a", 1, vec![true, false]).unwrap();
    let again = recording.push("a", 1, vec![true, false]).unwrap_err();
    assert_eq!(again.kind(), ErrorKind::AlreadyExists);
    let cfg = ExploreConfig::new(Strategy::Random).unwrap();
    let error = simulate(&recording, &OnlineConfig::default(), &cfg, 144).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape, "two minutes are not a day");
}

#[test]
fn looks_at_what_is_not_there_are_refused() {
    let mut beliefs = Beliefs::new([("a", 2)], &OnlineConfig::default());
    let time = Time::from_s(0);
    let no_place = beliefs.observe(1, time, &[true, true]).unwrap_err();
    assert_eq!(no_place.kind(), ErrorKind::NotFound);
    let one_state = beliefs.observe(0, time, &[true]).unwrap_err();
    assert_eq!(one_state.kind(), ErrorKind::Shape);
    assert_eq!(one_state.place(), Some("place `a`"));
}

#[test]
fn names_that_are_not_known_are_listed() {
    let error = "nearest".parse::<Strategy>().unwrap_err();
    assert!(error.help().unwrap().contains("monte-carlo"));
    let error = "oracle".parse::<OnlineConfig>().unwrap_err();
    assert!(error.help().unwrap().contains("fremen"));
    for name in OnlineConfig::names() {
        assert_eq!(name.parse::<OnlineConfig>().unwrap().to_string(), *name);
    }
    for strategy in Strategy::ALL {
        assert_eq!(strategy.name().parse::<Strategy>().unwrap(), strategy);
    }
}

#[test]
fn times_in_the_past_are_looks_that_are_learnt_from_and_not_the_last() {
    for name in OnlineConfig::names() {
        let mut beliefs = Beliefs::new([("a", 1)], &name.parse().unwrap());
        beliefs.observe(0, Time::from_s(86_400), &[true]).unwrap();
        beliefs.observe(0, Time::from_s(0), &[false]).unwrap();
        beliefs.learn().unwrap();
        assert_eq!(beliefs.last_look(0), Some(Time::from_s(86_400)), "{name}");
        let mut p = [f64::NAN];
        beliefs.predict_into(0, Time::from_s(-86_400), &mut p);
        assert!((0.0..=1.0).contains(&p[0]), "{name}");
    }
}
