//! A scene with everything in it evaluates no series once its run has an almanac, over all changes of the day.

use ::scene::Scene;
use base::time::{Span, Tai};
use base::{axes::Rotation, units::DAY_S};
use config::{Bench, Document, Setting};
use plan::attitude::LosPath;
use run::{runtime::RunParams, wiring::bench_parts};
use sky::almanac::Almanac;
use stars::Sky;

/// Returns a run about `middle` with stars, bodies, a target, stray light and zodiacal light.
fn run_about(middle: Tai, frame_period: Span) -> RunParams {
    let settings = [
        "sky.bodies=true",
        "camera.background={ sky = [\"zodiacal\"] }",
        "camera.baffle={ transmittance = [[0, 1e-6], [180, 1e-6]] }",
        "target=[{ orbit = \"circular\", altitude_km = 700.0, inclination_deg = 98.0, diameter_m = 2.0, albedo = 0.2 }]",
    ];
    let settings = settings.map(|setting| Setting::parse(setting).unwrap()).to_vec();
    let document = Document::built_in("benches/target_crossing.toml").unwrap().with_settings(settings);
    let params = bench_parts::run_params(&Bench::from_document(&document).unwrap(), middle).unwrap();
    let half = Span::from_ns(frame_period.ns() * i64::from(params.frames) / 2);
    RunParams { first_exposure: middle - half, frame_period, ..params }
}

/// Returns frames of the run in which series were evaluated; every frame.
fn follow(params: &RunParams, almanac: &Almanac) -> [usize; 2] {
    let sky = Sky::open(&[], params.camera.limiting_mag, 1).unwrap();
    let mut scene = Scene::new(&params.scene(almanac), &sky);
    let (mut late, mut with_stars) = (0, 0);
    for number in 0..params.frames {
        let start = params.exposure_start(number);
        let report = scene.find(&LosPath::commanded(Rotation::IDENTITY, start, params.camera.exposure_s), true);
        let report = report.unwrap();
        late += usize::from(report.evaluated_series);
        assert!(report.background.sky_e > 0.0 && report.lost_targets == 0);
        assert_eq!((scene.bodies.is_some(), scene.targets.targets().len()), (true, 1), "frame {number}");
        // In some frames the Earth fills the field and hides all stars.
        with_stars += u32::from(!scene.sources().is_empty());
    }
    assert!(with_stars > params.frames / 2, "stars in {with_stars} of {} frames", params.frames);
    [late, usize::try_from(params.frames).unwrap()]
}

#[test]
fn run_with_an_almanac_evaluates_no_series_at_any_change_of_day() {
    for middle in [
        // Noon of TDB, where its days since J2000.0 change, midnight, a leap second, and the table's first and last
        // day.
        "2026-03-01T11:58:50.816Z",
        "2026-03-01T00:00:00Z",
        "2016-12-31T23:59:60Z",
        "1989-12-28T11:58:50.816Z",
        "2052-01-08T11:58:50.816Z",
    ] {
        let middle = Tai::from_rfc3339(middle).unwrap();
        for frame_period in [Span::from_s(0.25), Span::from_s(0.3 * DAY_S)] {
            let params = run_about(middle, frame_period);
            let almanac = params.almanac();
            let [late, _] = follow(&params, &almanac);
            assert_eq!((late, almanac.evaluated()), (0, 0), "{middle}, a frame each {} s", frame_period.s());
        }
    }
}

#[test]
fn run_with_too_short_an_almanac_counts_the_frames_it_delays() {
    let middle = Tai::from_rfc3339("2026-03-01T11:58:50.816Z").unwrap();
    let params = run_about(middle, Span::from_s(0.3 * DAY_S));
    let almanac = Almanac::over(params.first_exposure, params.first_exposure);
    let [late, all] = follow(&params, &almanac);
    assert!(late > all / 2 && late < all && almanac.evaluated() > u64::try_from(late).unwrap(), "{late} of {all}");
}
