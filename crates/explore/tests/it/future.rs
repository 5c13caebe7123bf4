//! Does any strategy look at what has not happened yet?

use fremen::Time;
use fremen::online::OnlineConfig;
use fremen_explore::{ExploreConfig, Recording, Strategy, simulate};

use crate::worlds::rhythms_and_coins;

/// The same recording with every state turned over from `from` on.
fn poisoned(recording: &Recording, from: Time) -> Recording {
    let mut poisoned = Recording::new(recording.times().to_vec()).unwrap();
    for place in 0..recording.num_places() {
        let (name, num_states) = recording.place(place);
        let moments = recording.times().iter().enumerate();
        let states = moments.flat_map(|(moment, &time)| {
            let states = recording.states(place, moment).iter();
            states.map(move |&state| state != (time >= from))
        });
        poisoned.push(name, num_states, states.collect()).unwrap();
    }
    poisoned
}

#[test]
fn a_poisoned_future_changes_no_visit_and_no_error_before_it() {
    let recording = rhythms_and_coins(4, 1, 6, 600, 1);
    // In the middle of a day, so that plans that are changed within a day are held to it, too.
    let from = Time::from_s(4 * 86_400 + 43_200);
    let other = poisoned(&recording, from);
    for strategy in Strategy::ALL {
        for model in OnlineConfig::names() {
            let model: OnlineConfig = model.parse().unwrap();
            let cfg = ExploreConfig::new(strategy).unwrap().with_seed(5);
            let [a, b] = [&recording, &other].map(|recording| {
                let outcome = simulate(recording, &model, &cfg, 144).unwrap();
                let before = |visit: &&_| -> bool {
                    let visit: &fremen_explore::Visit = visit;
                    // A look in the slot that begins at `from` is the first that can differ.
                    visit.start <= from
                };
                let visits: Vec<_> = outcome.visits.iter().filter(before).copied().collect();
                (visits, outcome.by_day[..4].to_vec(), outcome.error)
            });
            assert_eq!(a.0, b.0, "{strategy} {model}");
            assert_eq!(a.1, b.1, "{strategy} {model}");
            assert_ne!(
                a.2, b.2,
                "{strategy} {model}: the poison has no effect at all"
            );
        }
    }
}
