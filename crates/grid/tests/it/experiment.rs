//! Do the experiments give what the documentation says of them?

use fremen_grid::experiment::{
    BoxesConfig, CarmenConfig, Corruption, InjectedConfig, JourneysConfig, PassesConfig,
    QuarantineConfig, boxes, carmen, injected, journeys, passes, quarantine,
};
use fremen_grid::pose::{Pose2, wrap};
use fremen_grid::random::Random;
use fremen_grid::registration::GuardConfig;
use fremen_grid::scan::{CarmenLog, CarmenScan, read_carmen};
use fremen_grid::simulation::{BoxPeriods, Laser, Layout, Scene};
use fremen_grid::{ErrorKind, Result, Time};

#[test]
fn predicted_maps_serve_as_well_as_the_truth_and_better_than_the_night() -> Result<()> {
    let config = PassesConfig {
        seeds: vec![100, 101],
        layout: Layout::Development,
        num_days: 5,
        every_h: 6.0,
        num_passes: 3,
        ranges_m: vec![2.0],
        ..PassesConfig::default()
    };
    let report = passes(&config)?;
    assert_eq!(report, passes(&config)?);
    let [night, predicted, oracle] = [0, 3, 4].map(|map| report.median_m(0, map));
    assert!(
        predicted < 0.06 && predicted < 2.0 * oracle,
        "{predicted} {oracle}"
    );
    assert!(predicted < night, "{predicted} {night}");
    assert_eq!(report.share_above(0, 3, 0.15), 0.0);
    assert!(report.table().lines().count() == 3);
    Ok(())
}

/// A few patrols of one small office.
fn few_patrols() -> QuarantineConfig {
    QuarantineConfig {
        seeds: vec![100],
        layout: Layout::Development,
        num_patrols: 16,
        resolution_m: 0.1,
        corrupted: 0.5,
        guard: GuardConfig {
            num_trusted: 8,
            ..GuardConfig::default()
        },
        ..QuarantineConfig::default()
    }
}

#[test]
fn corrupted_maps_are_kept_out_and_would_harm() -> Result<()> {
    let report = quarantine(&few_patrols())?;
    let (corrupted, good) = (report.corrupted(), report.good());
    assert!(
        corrupted.0 >= 2 && corrupted.0 == corrupted.1,
        "{corrupted:?}"
    );
    assert!(good.0 >= 2 && good.1 == 0, "{good:?}");
    let [guarded, unguarded] = report.final_errors();
    assert!(guarded < unguarded, "{guarded} {unguarded}");
    let patrols = &report.offices[0].unguarded;
    assert!(patrols.iter().all(|patrol| !patrol.is_quarantined));
    assert!(
        patrols
            .iter()
            .any(|patrol| patrol.corruption != Corruption::None)
    );
    Ok(())
}

#[test]
fn furniture_that_stays_where_it_was_moved_to_is_adopted() -> Result<()> {
    let config = QuarantineConfig {
        corrupted: 0.0,
        rearranged_at: Some(9),
        ..few_patrols()
    };
    let patrols = &quarantine(&config)?.offices[0].guarded;
    // Not believed at once, but within five patrols, and the maps after that are believed.
    assert!(patrols[9].is_quarantined && !patrols[9].is_adopted);
    let adopted = patrols.iter().position(|patrol| patrol.is_adopted);
    assert!(adopted.is_some_and(|number| number <= 13), "{adopted:?}");
    assert!(patrols[14..].iter().all(|patrol| !patrol.is_quarantined));
    Ok(())
}

#[test]
fn ways_are_planned_round_what_is_predicted() -> Result<()> {
    let config = JourneysConfig {
        seeds: vec![100],
        layout: Layout::Development,
        num_days: 7,
        num_journeys: 6,
        every_h: 2.0,
        ..JourneysConfig::default()
    };
    let report = journeys(&config)?;
    let totals = report.totals();
    // Who knows everything is stopped at most where something moves within a minute.
    assert!(totals[4].num_blocked <= 1, "{totals:?}");
    assert!(totals[0].num_journeys >= 5 && totals[4].num_arrived == totals[4].num_journeys);
    assert!(totals[3].num_blocked <= totals[0].num_blocked);
    assert_eq!(report.table().lines().count(), 7);
    Ok(())
}

#[test]
fn boxes_with_known_periods_are_foreseen() -> Result<()> {
    let config = BoxesConfig {
        seeds: vec![3],
        periods: BoxPeriods::Candidates,
        duration_s: 3_000,
        warm_up_s: 2_400,
        resolution_m: 0.2,
        every: 3,
        ..BoxesConfig::default()
    };
    let report = boxes(&config)?;
    assert_eq!(report, boxes(&config)?);
    let [rhythms, persistent, _, folded, last, averaged, truth] = report.counts;
    assert_eq!((report.worlds.len(), report.over_time.len()), (1, 1));
    // Two rhythms of a cell round off the edges of its square wave; its phase histogram does not.
    let [even, careful] = folded;
    assert!(even.recall() > rhythms[0].recall(), "{even:?} {rhythms:?}");
    assert!(careful.recall() > 0.9, "{careful:?}");
    for other in [rhythms[0], persistent[0], last[0], averaged[0]] {
        assert!(careful.recall() > other.recall(), "{careful:?} {other:?}");
    }
    assert!(
        careful.accuracy() > last[0].accuracy(),
        "{careful:?} {last:?}"
    );
    assert!(
        persistent[0].accuracy() > averaged[0].accuracy(),
        "{persistent:?} {averaged:?}"
    );
    assert!(truth[0].recall() > 0.98, "{truth:?}");
    assert_eq!(even.num_obstacles, last[0].num_obstacles);
    Ok(())
}

/// Scans from a way round the middle of a room of 12 x 8 m.
fn room() -> Result<CarmenLog> {
    let mut walls = Scene::default();
    walls.add_box([0.0, 0.0], [12.0, 8.0]);
    walls.add_box([5.0, 3.5], [7.0, 4.5]);
    let laser = Laser {
        num_beams: 181,
        dropout: 0.0,
        ..Laser::default()
    };
    let mut random = Random::stream(3, &[7]);
    let scans = (0..720).map(|number| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(number) / 120.0).sin_cos();
        let heading = wrap(0.4 * f64::from(number));
        let pose = Pose2::new(6.0 + 2.2 * cos, 4.0 + 1.6 * sin, heading);
        Ok(CarmenScan {
            time: Time::from_s(i64::from(number)),
            pose,
            odometry: pose,
            scan: laser.scan(&walls, &pose, &mut random)?,
        })
    });
    Ok(CarmenLog {
        scans: scans.collect::<Result<_>>()?,
        ..CarmenLog::default()
    })
}

#[test]
fn boxes_that_are_put_into_scans_are_found_as_quarantine_or_as_a_rhythm() -> Result<()> {
    let config = InjectedConfig {
        carmen: CarmenConfig {
            resolution_m: 0.1,
            ..CarmenConfig::default()
        },
        num_patrols: 56,
        num_daily: 3,
        num_sudden: vec![8],
        ..InjectedConfig::default()
    };
    let report = injected(&room()?, &config)?;
    let sudden = report.sudden[0];
    assert!(sudden.num_changed >= 6, "{sudden:?}");
    assert_eq!(sudden.num_changed_held, sudden.num_changed, "{sudden:?}");
    assert!(sudden.num_unchanged_held <= 1, "{sudden:?}");
    let daily = report.daily;
    assert!(daily.num_there > 100 && daily.num_gone > 100, "{daily:?}");
    let [.., folded, last] = daily.num_there_foreseen;
    assert!(
        10 * folded > 8 * daily.num_there && 5 * last < 4 * folded,
        "{daily:?}"
    );
    assert!(
        10 * daily.num_gone_foreseen[3] > 9 * daily.num_gone,
        "{daily:?}"
    );
    assert!(10 * daily.num_of_a_day > 8 * daily.num_cells, "{daily:?}");
    assert!(report.moved.believed_after < 5, "{:?}", report.moved);
    assert!(10 * report.moved.num_there_foreseen > 8 * report.moved.num_there);
    assert_eq!(report.seen.len(), config.num_patrols);
    assert!(report.pictures.len() >= 6);
    Ok(())
}

#[test]
fn a_log_that_is_too_short_is_refused() {
    let error = carmen(&CarmenLog::default(), &CarmenConfig::default()).expect_err("no scans");
    assert_eq!(error.kind(), ErrorKind::Config);
}

#[test]
fn real_data_of_a_robot_in_an_office_make_a_map_in_which_it_finds_itself() -> Result<()> {
    let path = "grids/carmen/intel-corrected.log.gz";
    let Some(root) = std::env::var_os("CHRONOTOPE_DATA") else {
        eprintln!("SKIPPED: set CHRONOTOPE_DATA to the datasets' folder to test with {path}");
        return Ok(());
    };
    let log = read_carmen(std::path::PathBuf::from(root).join(path))?;
    assert_eq!((log.scans.len(), log.num_out_of_order), (910, 4));
    let config = CarmenConfig {
        ranges_m: vec![5.0],
        ..CarmenConfig::default()
    };
    let report = carmen(&log, &config)?;
    assert!(report.within_one_cell > 0.95, "{report:?}");
    assert!(report.ranges[0].within_10_cm >= 0.95, "{report:?}");
    assert!(report.ranges[0].global > 0.95, "{report:?}");
    Ok(())
}
