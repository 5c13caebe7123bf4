//! How long does the plan of a day take: 144 slots for 1,000 places whose states are summarised as
//! one each, for 1,000 places that were learnt from looks, and for a map of 1,000 places with 500
//! features each? On one thread; prints the fastest of nine, and the memory.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "an example that cannot prepare itself has nothing else to say"
)]

use std::time::Instant;

use fremen::online::OnlineConfig;
use fremen::spectrum::CandidatePeriods;
use fremen::visibility::Fremen;
use fremen::{Period, Time};
use fremen_explore::{Beliefs, ExploreConfig, Explored, Fitted, Slots, Strategy, plan};

/// Places with so many features of two rhythms of the day each.
fn map(num_places: usize, num_features: usize) -> Fitted {
    let candidates = CandidatePeriods::harmonic(Period::DAY, 24).unwrap();
    let mut fitted = Fitted::new();
    let mut number = 0_u64;
    let mut unit = || {
        number = number
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (number >> 11) as f64 / (1_u64 << 53) as f64
    };
    for place in 0..num_places {
        let mean = (0..num_features).map(|_| unit()).collect();
        let candidate = (0..2 * num_features)
            .map(|_| (unit() * 24.0) as u16)
            .collect();
        let terms = (0..2 * num_features)
            .map(|_| (unit() - 0.5, unit() - 0.5))
            .collect();
        let model = Fremen::from_parts(candidates.clone(), 2, mean, candidate, terms).unwrap();
        fitted
            .push(format!("place {place}"), Box::new(model), 20.0, None)
            .unwrap();
    }
    fitted
}

/// One p for each place and slot, worked out before.
struct Summaries {
    slots: Slots,
    p: Vec<f32>,
}

impl Explored for Summaries {
    fn num_places(&self) -> usize {
        self.p.len() / self.slots.len()
    }

    fn name(&self, _place: usize) -> &'static str {
        "place"
    }

    fn num_states(&self, _place: usize) -> usize {
        1
    }

    fn predict_into(&self, place: usize, time: Time, out: &mut [f64]) {
        let slot = self.slots.slot_of(time).unwrap_or_default();
        out.fill(self.p[place * self.slots.len() + slot].into());
    }

    fn looks(&self, _place: usize, _time: Time) -> f64 {
        20.0
    }

    fn kept(&self, _place: usize, age_s: f64) -> f64 {
        (-age_s / 3_600.0).exp()
    }
}

/// A week of looks every two hours at places of one state, learnt by the default model.
fn learnt(num_places: usize) -> Beliefs {
    let names: Vec<String> = (0..num_places)
        .map(|place| format!("place {place}"))
        .collect();
    let places = names.iter().map(|name| (name.as_str(), 1));
    let mut beliefs = Beliefs::new(places, &OnlineConfig::default());
    for look in 0..84_i64 {
        for place in 0..num_places {
            let hour = (look * 2 + place as i64 * 7) % 24;
            let time = Time::from_s(look * 7_200 - 7 * 86_400);
            beliefs
                .observe(place, time, &[(8..16).contains(&hour)])
                .unwrap();
        }
        if look % 12 == 11 {
            beliefs.learn().unwrap();
        }
    }
    beliefs
}

fn main() {
    let slots = Slots::of_s(Time::from_s(0), 600.0, 144).unwrap();
    let p = (0..144_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0);
    let summaries = Summaries {
        slots,
        p: p.collect(),
    };
    let learnt = learnt(1_000);
    let visual = map(1_000, 500);
    let cases: [(&dyn Explored, &str, f64); 3] = [
        (&summaries, "summaries", 10.0),
        (&learnt, "learnt from looks", 10.0),
        (&visual, "of 500 features", 300.0),
    ];
    for (places, name, limit_ms) in cases {
        let cfg = ExploreConfig::new(Strategy::Information).unwrap();
        let best_ms = (0..9)
            .map(|_| {
                let start = Instant::now();
                let planned = plan(places, slots, &cfg).unwrap();
                assert_eq!(planned.num_visits(), 72);
                1e3 * start.elapsed().as_secs_f64()
            })
            .fold(f64::INFINITY, f64::min);
        // For each place and slot four numbers of the outlook, and what a look adds.
        let plan_mb = f64::from(1_000 * 144 * (6 * 8 + 12)) / 1e6;
        println!(
            "1,000 places {name}: {best_ms:.1} ms (at most {limit_ms} ms), plan {plan_mb:.1} MB"
        );
    }
    // A mean and two rhythms of 18 bytes.
    println!(
        "models of 500 features: {:.1} MB",
        0.5 * f64::from(8 + 2 * 18)
    );
}
