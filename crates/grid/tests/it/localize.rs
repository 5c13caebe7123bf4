//! Does a robot find itself in a map, and notice that the map is wrong?

use fremen_grid::cells::Thresholds;
use fremen_grid::localize::{
    BeamModel, BeamModelConfig, Diagnosis, DistanceField, Estimate, FilterConfig, FreeSpace,
    LikelihoodField, LikelihoodFieldConfig, MonteCarlo, Outdated, PlaceSearch, Readings, ScanFit,
    SensorModel,
};
use fremen_grid::pose::Pose2;
use fremen_grid::random::Random;
use fremen_grid::simulation::{Drive, DriveConfig, Layout, MONDAY, Office, drive_along};
use fremen_grid::{OccupancyMap, Result, Time};

fn at(day: i64, hour: i64) -> Time {
    MONDAY.plus_us((day * 24 + hour) * 3_600_000_000)
}

/// A drive through both rooms and the corridor, and the true map of that time.
fn patrol(seed: u64, time: Time) -> Result<(Office, Drive, OccupancyMap)> {
    let office = Office::new(seed, Layout::Development);
    let map = office.true_map(time, office.spec(0.05)?);
    let drive = drive_along(
        &office.patrol(time, 0.25),
        time,
        &|time| office.scene(time),
        &DriveConfig::default(),
        &mut Random::new(seed),
    )?;
    Ok((office, drive, map))
}

fn follow(
    filter: &mut MonteCarlo,
    drive: &Drive,
    sensor: &dyn SensorModel,
    space: &FreeSpace,
) -> Result<Vec<Estimate>> {
    (drive.motions.iter().zip(&drive.scans))
        .map(|(motion, scan)| filter.step(motion, scan, sensor, space))
        .collect()
}

/// Distances to the truth, in ascending order.
fn errors(drive: &Drive, estimates: &[Estimate]) -> Vec<f64> {
    let mut errors: Vec<f64> = (drive.truth.iter().zip(estimates))
        .map(|(truth, estimate)| truth.distance_m(&estimate.pose))
        .collect();
    errors.sort_by(f64::total_cmp);
    errors
}

#[test]
fn both_models_follow_a_robot_within_a_cell_or_two() -> Result<()> {
    let (_, drive, map) = patrol(3, at(1, 14))?;
    let space = FreeSpace::of(&map, Thresholds::default())?;
    let field = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
    let beams = BeamModel::new(&map, BeamModelConfig::default())?;
    let models: [(&str, &dyn SensorModel); 2] = [("field", &field), ("beams", &beams)];
    for (name, model) in models {
        let config = FilterConfig {
            min_particles: 500,
            ..FilterConfig::default()
        };
        let mut filter = MonteCarlo::around(&drive.truth[0], 0.2, 0.1, config, 1)?;
        let estimates = follow(&mut filter, &drive, model, &space)?;
        let errors = errors(&drive, &estimates);
        let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
        assert!(median < 0.05 && worst < 0.3, "{name}: {median} {worst}");
        // Sure of itself, with few particles.
        let last = estimates[estimates.len() - 1];
        assert!(last.share > 0.9 && last.num_particles < 2_000, "{last:?}");
    }
    Ok(())
}

#[test]
fn a_robot_that_may_be_anywhere_finds_itself_and_one_that_is_carried_away_again() -> Result<()> {
    let mut num_found = 0;
    let mut num_recovered = 0;
    for seed in 0..3 {
        let (office, drive, map) = patrol(seed, at(1, 14))?;
        let space = FreeSpace::of(&map, Thresholds::default())?;
        let field = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
        let mut filter = MonteCarlo::anywhere(&space, FilterConfig::default(), seed)?;
        assert_eq!(
            filter.particles().len(),
            FilterConfig::default().max_particles
        );
        let estimates = follow(&mut filter, &drive, &field, &space)?;
        let last = estimates.len() - 1;
        num_found += i32::from(estimates[last].pose.distance_m(&drive.truth[last]) < 0.2);
        // Carried to the other room; the wheels do not turn.
        let time = at(1, 15);
        let path = office.patrol(time, 0.25);
        let (from, to) = (path.len() / 3, path.len());
        let (laser, mut random) = (DriveConfig::default(), Random::new(seed));
        let scene = |time| office.scene(time);
        let rest = drive_along(&path[from..to], time, &scene, &laser, &mut random)?;
        let estimates = follow(&mut filter, &rest, &field, &space)?;
        let last = estimates.len() - 1;
        num_recovered += i32::from(estimates[last].pose.distance_m(&rest.truth[last]) < 0.2);
    }
    assert_eq!((num_found, num_recovered), (3, 3));
    Ok(())
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads() -> Result<()> {
    let (_, drive, map) = patrol(5, at(2, 11))?;
    let space = FreeSpace::of(&map, Thresholds::default())?;
    let field = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
    let mut begin = drive.clone();
    begin.motions.truncate(25);
    let run = |num_threads: usize, seed: u64| -> Result<Vec<Estimate>> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(num_threads)
            .build();
        pool.expect("threads").install(|| {
            let config = FilterConfig {
                max_particles: 3_000,
                ..FilterConfig::default()
            };
            let mut filter = MonteCarlo::anywhere(&space, config, seed)?;
            let mut estimates = follow(&mut filter, &begin, &field, &space)?;
            let search = PlaceSearch {
                num_tries: 2_000,
                ..PlaceSearch::default()
            };
            let (found, _) = search
                .best(&drive.scans[9], &field, &space, seed)
                .expect("tries");
            estimates[0].pose = found;
            Ok(estimates)
        })
    };
    let alone = run(1, 7)?;
    assert_eq!(alone, run(2, 7)?);
    assert_eq!(alone, run(5, 7)?);
    assert_ne!(alone, run(1, 8)?);
    Ok(())
}

#[test]
fn what_is_no_motion_or_no_place_is_refused_and_changes_nothing() -> Result<()> {
    let (_, drive, map) = patrol(5, at(2, 11))?;
    let space = FreeSpace::of(&map, Thresholds::default())?;
    let field = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
    let config = FilterConfig::default();
    let nowhere = Pose2::new(f64::NAN, 0.0, 0.0);
    assert!(MonteCarlo::around(&nowhere, 0.1, 0.1, config, 1).is_err());
    let mut filter = MonteCarlo::around(&drive.truth[0], 0.1, 0.1, config, 1)?;
    let before = filter.particles().to_vec();
    assert!(
        filter
            .step(&nowhere, &drive.scans[0], &field, &space)
            .is_err()
    );
    assert_eq!(filter.particles(), before);
    assert!(
        FreeSpace::of(
            &OccupancyMap::new_unknown(*map.spec()),
            Thresholds::default()
        )
        .is_err()
    );
    let wrong = FilterConfig {
        min_particles: 0,
        ..config
    };
    assert!(MonteCarlo::anywhere(&space, wrong, 1).is_err());
    Ok(())
}

/// The contradiction of a run whose robot is where it believes to be.
fn contradiction(map: &OccupancyMap, drive: &Drive) -> f64 {
    let thresholds = Thresholds::default();
    let field = DistanceField::new(map, thresholds, 0.5);
    let mut sum = ScanFit::default();
    for (pose, scan) in drive.truth.iter().zip(&drive.scans) {
        sum.add(&ScanFit::of(map, &field, thresholds, pose, scan, 0.15));
    }
    sum.contradiction()
}

#[test]
fn an_outdated_map_and_a_lost_robot_are_told_apart_and_right_maps_are_believed() -> Result<()> {
    let office = Office::new(8, Layout::Development);
    let spec = office.spec(0.05)?;
    let rearranged = Office::new(8, Layout::Development).rearranged_at(at(40, 0));
    let short = |time: Time, seed: u64, office: &Office| -> Result<Drive> {
        let path = office.patrol(time, 1.0);
        let (config, mut random) = (DriveConfig::default(), Random::new(seed));
        drive_along(
            &path,
            time,
            &|time| office.scene(time),
            &config,
            &mut random,
        )
    };
    let mut past = Vec::new();
    for day in 0..20 {
        let time = at(day, 8 + day % 10);
        let map = office.true_map(time, spec);
        past.push(contradiction(&map, &short(time, day as u64, &office)?));
    }
    let test = Outdated::new(past)?;
    // Right maps of other days are believed.
    let mut num_alarms = 0;
    for day in 20..40 {
        let time = at(day, 8 + day % 9);
        let drive = short(time, day as u64, &office)?;
        let score = contradiction(&office.true_map(time, spec), &drive);
        num_alarms += i32::from(test.is_outdated(score, 0.05));
    }
    assert!(
        num_alarms <= 4,
        "{num_alarms} of 20 right maps are called outdated"
    );
    // Furniture was moved: the map of the day before is outdated.
    let (before, time) = (at(39, 12), at(40, 12));
    let map = rearranged.true_map(before, spec);
    let drive = short(time, 77, &rearranged)?;
    let field = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
    let space = FreeSpace::of(&map, Thresholds::default())?;
    let score = contradiction(&map, &drive);
    let search = PlaceSearch::default();
    let judge = |scan: usize, believed: &Pose2, score: f64| {
        let readings = Readings::of(&drive.scans[scan], search.num_beams);
        let here = field.mean_log_likelihood(believed, &readings);
        let best = search
            .best(&drive.scans[scan], &field, &space, 1)
            .expect("tries");
        Diagnosis::of(score, &test, 0.05, here, &best, 0.15)
    };
    let outdated = judge(2, &drive.truth[2], score);
    assert!(
        matches!(outdated, Diagnosis::MapOutdated { .. }),
        "{outdated:?}"
    );
    // A robot in a right map that believes to be elsewhere is lost.
    let wrong = Pose2::new(drive.truth[2].x_m, drive.truth[2].y_m, 2.0);
    let lost = judge(2, &wrong, score);
    assert!(matches!(lost, Diagnosis::Lost { .. }), "{lost:?}");
    assert_eq!(judge(2, &drive.truth[2], 0.0), Diagnosis::Fine);
    Ok(())
}
