use super::*;

const LIMIT: FalseLimit = FalseLimit { directional_arcsec: 300.0, rotational_arcsec: 3000.0 };

fn truth(frame: u32, rate_rad_s: DVec3) -> TruthRow {
    let t_s = f64::from(frame) * 0.1;
    let attitude = turned(DQuat::from_rotation_x(0.3), rate_rad_s * t_s);
    TruthRow {
        frame,
        mid_ns: i64::from(frame) * 100_000_000,
        exposure_s: 0.05,
        attitude,
        rate_rad_s,
        group: 0,
        has_fault: false,
    }
}

fn case(log: Vec<LogRow>, rate_rad_s: DVec3) -> Case {
    let truth = (0..5).map(|frame| truth(frame, rate_rad_s)).collect();
    Case { name: "x".into(), purpose: Use::Run, conditions: BTreeMap::new(), truth, log }
}

#[test]
fn rows_find_their_frames_by_number_or_time() {
    let of = |frame: Option<u32>, at_ns: Option<i64>| {
        let row = LogRow { frame, at_ns, attitude: Some(truth(3, DVec3::ZERO).attitude), ..LogRow::default() };
        let judged = case(vec![row], DVec3::ZERO).judged(&LIMIT);
        (judged.frames.iter().position(Judged::is_right), judged.stray_rows)
    };
    assert_eq!(of(Some(3), None), (Some(3), 0));
    assert_eq!(of(None, Some(310_000_000)), (Some(3), 0), "10 ms off");
    assert_eq!(of(Some(2), Some(310_000_000)), (Some(2), 0), "the number counts more");
    assert_eq!(of(Some(9), None), (None, 1));
    assert_eq!(of(None, Some(470_000_000)), (None, 1), "too late for any");
    assert_eq!(of(None, None), (None, 1));
}

#[test]
fn a_late_time_tag_is_an_error_along_the_motion() {
    let rate = DVec3::new(0.0, 0.01, 0.002);
    let row = LogRow {
        frame: Some(2),
        at_ns: Some(200_000_000 + 3_000_000),
        attitude: Some(truth(2, rate).attitude),
        available_ns: Some(250_000_000),
        stars: None,
    };
    let judged = case(vec![row], rate).judged(&LIMIT).frames[2];
    let error = judged.error_rad().unwrap();
    assert!((error + rate * 3e-3).length() < 1e-9, "{error}: it shows where the frame was 3 ms ago");
    assert!((judged.tag_error_s.unwrap() - 3e-3).abs() < 1e-12);
    assert!((judged.latency_s.unwrap() - 0.075).abs() < 1e-12, "from the start of the exposure");
}

#[test]
fn far_attitudes_are_false_and_the_first_counts() {
    let right = truth(1, DVec3::ZERO).attitude;
    let row = |attitude| LogRow { frame: Some(1), attitude, ..LogRow::default() };
    let fate = |rows: Vec<LogRow>| case(rows, DVec3::ZERO).judged(&LIMIT).frames[1].fate;
    let off = turned(right, DVec3::X * 301.0 * ARCSEC);
    assert!(matches!(fate(vec![row(Some(off))]), Fate::False(_)));
    assert!(matches!(fate(vec![row(Some(turned(right, DVec3::X * 299.0 * ARCSEC)))]), Fate::Right(_)));
    assert!(matches!(fate(vec![row(Some(turned(right, DVec3::Z * 3001.0 * ARCSEC)))]), Fate::False(_)));
    assert!(matches!(fate(vec![row(Some(off)), row(Some(right))]), Fate::False(_)), "it cannot be taken back");
    assert!(matches!(fate(vec![row(None), row(Some(right))]), Fate::Right(_)));
    assert!(matches!(fate(vec![]), Fate::Nothing));
    assert!(matches!(fate(vec![row(Some(right.conjugate()))]), Fate::False(_)), "the conjugate is another attitude");
}
