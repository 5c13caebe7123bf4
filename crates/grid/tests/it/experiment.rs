//! Do the experiments give what the documentation says of them?

use fremen_grid::experiment::{CarmenConfig, PassesConfig, carmen, passes};
use fremen_grid::scan::{CarmenLog, read_carmen};
use fremen_grid::simulation::Layout;
use fremen_grid::{ErrorKind, Result};

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
