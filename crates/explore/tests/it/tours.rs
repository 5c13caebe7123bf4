//! Are tours on time, and near the best there are?

use fremen::{ErrorKind, Period, Time};
use fremen_explore::{Charger, Opening, Roads, Stop, Tour, TourConfig, tour};

use crate::worlds::Numbers;

const MINUTE_S: i64 = 60;

/// A small world with rewards that change with the hour and fall with earlier visits.
struct World {
    roads: Roads,
    rewards: Vec<Vec<f64>>,
    visit_s: f64,
    minutes: i64,
}

impl World {
    fn new(seed: u64) -> Self {
        let mut numbers = Numbers::new(seed);
        let num_places = 3 + (numbers.unit() * 3.0) as usize;
        let mut links = Vec::new();
        for a in 0..num_places {
            for b in 0..a {
                if b + 1 == a || numbers.unit() < 0.5 {
                    links.push((a, b, (1.0 + (numbers.unit() * 8.0).floor()) * 60.0));
                }
            }
        }
        let minutes = 50;
        let rewards = (0..num_places)
            .map(|_| (0..minutes / 10).map(|_| numbers.unit().powi(2)).collect())
            .collect();
        Self {
            roads: Roads::new(num_places, &links).unwrap(),
            rewards,
            visit_s: 300.0 + 60.0 * (numbers.unit() * 5.0).floor(),
            minutes: i64::from(minutes),
        }
    }

    fn value(&self, place: usize, start: Time, earlier: &[Time]) -> f64 {
        let minute = start.as_us() / 60_000_000;
        let reward = self.rewards[place][(minute / 10).min(self.minutes / 10 - 1) as usize];
        earlier.last().map_or(reward, |&last| {
            reward * (1.0 - (-start.since_s(last) / 1_800.0).exp())
        })
    }

    fn cfg(&self) -> TourConfig {
        let end = Time::from_s(self.minutes * MINUTE_S);
        TourConfig::new(Time::from_s(0), end, 0, self.rewards.len(), self.visit_s)
            .unwrap()
            .with_step(Period::from_s(300.0).unwrap())
    }

    /// The best by trying everything: any place next, now or after any number of steps of waiting.
    fn best(&self, time: Time, at: usize, visits: &mut Vec<(usize, Time)>, left_s: f64) -> f64 {
        let end = Time::from_s(self.minutes * MINUTE_S);
        let mut best = 0.0_f64;
        let mut from = time;
        while from < end {
            for place in 0..self.rewards.len() {
                let Some(travel_s) = self.roads.travel_s(at, place) else {
                    continue;
                };
                let start = from.plus_us((travel_s * 1e6) as i64);
                let until = start.plus_us((self.visit_s * 1e6) as i64);
                let spent_s = travel_s + self.visit_s;
                if until > end || spent_s > left_s {
                    continue;
                }
                let of_place = visits.iter().filter(|visit| visit.0 == place);
                let earlier: Vec<Time> = of_place.map(|visit| visit.1).collect();
                let value = self.value(place, start, &earlier);
                visits.push((place, start));
                best = best.max(value + self.best(until, place, visits, left_s - spent_s));
                visits.pop();
            }
            from = from.plus_us(300_000_000);
        }
        best
    }
}

/// Nothing overlaps, and every stop can be reached from the one before it.
fn is_on_time(tour: &Tour, roads: &Roads, start: Time, at: usize) {
    let (mut time, mut place) = (start, at);
    for stop in &tour.stops {
        let travel_s = roads.travel_s(place, stop.place).expect("there is a way");
        assert!(
            stop.start.since_s(time) >= travel_s - 1e-6,
            "late at {stop:?}"
        );
        assert!(stop.end > stop.start);
        (time, place) = (stop.end, stop.place);
    }
}

#[test]
fn tours_are_within_5_percent_of_the_best_on_200_small_worlds() {
    let mut shares = Vec::new();
    for seed in 0..200 {
        let world = World::new(seed);
        let budget_s = if seed % 2 == 0 { 3_000.0 } else { 1_500.0 };
        let cfg = world.cfg().with_budget_s(budget_s).unwrap();
        let value =
            |place: usize, start: Time, earlier: &[Time]| world.value(place, start, earlier);
        let found = tour(&value, &world.roads, &cfg).unwrap();
        is_on_time(&found, &world.roads, Time::from_s(0), 0);
        assert!(found.spent_s <= budget_s + 1e-6);
        let best = world.best(Time::from_s(0), 0, &mut Vec::new(), budget_s);
        let share = if best > 0.0 { found.value / best } else { 1.0 };
        if share < 0.95 {
            println!(
                "seed {seed}: {share:.3} of {best:.3}, {} places, visit {} s, budget {budget_s}",
                world.rewards.len(),
                world.visit_s
            );
        }
        shares.push(share);
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let worst = shares.iter().copied().fold(1.0, f64::min);
    let within = shares.iter().filter(|share| **share >= 0.95).count();
    println!("mean {mean:.4} of the best, worst {worst:.4}, {within} of 200 within 5 %");
    assert!(
        shares.iter().all(|share| *share <= 1.0 + 1e-9),
        "better than the best"
    );
    assert!(
        mean >= 0.99 && within == 200,
        "mean {mean}, worst {worst}, {within} within 5 %"
    );
}

#[test]
fn islands_are_never_visited() {
    let roads = Roads::new(4, &[(0, 1, 30.0), (2, 3, 10.0)]).unwrap();
    let cfg = TourConfig::new(Time::from_s(0), Time::from_s(7_200), 0, 4, 600.0).unwrap();
    let value = |place: usize, _: Time, _: &[Time]| 1.0 + place as f64;
    let found = tour(&value, &roads, &cfg).unwrap();
    is_on_time(&found, &roads, Time::from_s(0), 0);
    assert!(found.stops.len() >= 10 && found.stops.iter().all(|stop| stop.place < 2));
    assert_eq!(roads.travel_s(0, 3), None);
}

#[test]
fn openings_and_the_battery_are_kept_to() {
    let roads = Roads::new(3, &[(0, 1, 60.0), (1, 2, 60.0)]).unwrap();
    let (from, to) = (Time::from_s(3_600), Time::from_s(7_200));
    let charger = Charger {
        place: 0,
        run_s: 5_400.0,
        charge_s: 1_800.0,
    };
    let cfg = TourConfig::new(Time::from_s(0), Time::from_s(6 * 3_600), 0, 3, 600.0)
        .unwrap()
        .with_openings(2, vec![Opening { from, to }])
        .unwrap()
        .with_charger(charger)
        .unwrap();
    let value =
        |place: usize, _: Time, earlier: &[Time]| (1 + place) as f64 / (1 + earlier.len()) as f64;
    let found = tour(&value, &roads, &cfg).unwrap();
    is_on_time(&found, &roads, Time::from_s(0), 0);
    let in_two: Vec<_> = found.stops.iter().filter(|stop| stop.place == 2).collect();
    assert!(!in_two.is_empty() && in_two.iter().all(|it| from <= it.start && it.end <= to));
    let mut charged = Time::from_s(0);
    let mut num_charges = 0;
    for stop in &found.stops {
        if stop.stop == Stop::Charge {
            assert!(stop.start.since_s(charged) <= charger.run_s);
            charged = stop.end;
            num_charges += 1;
        }
        let way_s = roads.travel_s(stop.place, 0).unwrap();
        assert!(stop.end.since_s(charged) + way_s <= charger.run_s + 1e-6);
    }
    assert!(num_charges >= 2, "{found:?}");
}

#[test]
fn roads_that_cannot_be_are_refused() {
    for travel_s in [-1.0, f64::NAN, f64::INFINITY] {
        let error = Roads::new(2, &[(0, 1, travel_s)]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Config, "{travel_s}");
    }
    assert_eq!(
        Roads::new(2, &[(0, 2, 1.0)]).unwrap_err().kind(),
        ErrorKind::NotFound
    );
    let roads = Roads::parse(
        "node a\nnode hall\nlink a hall 5\n\n# way\nlink hall b 7\n",
        &["a", "b"],
    );
    assert_eq!(roads.unwrap().travel_s(0, 1), Some(12.0));
    for (text, line) in [
        ("link a b", "line 1"),
        ("link a b soon", "line 1"),
        ("node a\nlink a c 3", "line 2"),
        ("door a b 3", "line 1"),
    ] {
        let error = Roads::parse(text, &["a", "b"]).unwrap_err();
        assert_eq!(
            (error.kind(), error.place()),
            (ErrorKind::Format, Some(line)),
            "{text}"
        );
    }
    assert!(Roads::parse("link a b -3", &["a", "b"]).is_err());
}

#[test]
fn tours_that_cannot_be_are_refused() {
    let (start, end) = (Time::from_s(0), Time::from_s(3_600));
    assert!(TourConfig::new(end, start, 0, 2, 600.0).is_err());
    assert!(TourConfig::new(start, end, 2, 2, 600.0).is_err());
    for visit_s in [0.0, -1.0, f64::NAN] {
        assert!(TourConfig::new(start, end, 0, 2, visit_s).is_err());
    }
    let cfg = TourConfig::new(start, end, 0, 2, 600.0).unwrap();
    assert!(cfg.clone().with_budget_s(-1.0).is_err());
    let charger = |place, run_s| Charger {
        place,
        run_s,
        charge_s: 60.0,
    };
    assert!(cfg.clone().with_charger(charger(2, 60.0)).is_err());
    assert!(cfg.clone().with_charger(charger(0, 0.0)).is_err());
    assert!(cfg.clone().with_width(0).is_err());
    let value = |_: usize, _: Time, _: &[Time]| 1.0;
    assert!(tour(&value, &Roads::none(3), &cfg).is_err());
    let nothing = |_: usize, _: Time, _: &[Time]| 0.0;
    assert!(
        tour(&nothing, &Roads::none(2), &cfg)
            .unwrap()
            .stops
            .is_empty()
    );
}
