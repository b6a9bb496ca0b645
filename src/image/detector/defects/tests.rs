use super::*;

const SPACE: DefectSpace = DefectSpace { size_px: [64, 32], charge_binning: 1, defects: 1000, pixels: 1000 };

fn list() -> Defects {
    Defects::new(SPACE, 7, 0.1)
}

/// Returns an image of zeros with the stuck pixels in it.
fn stuck_image(defects: &Defects, size_px: [usize; 2]) -> DnImage {
    let mut image = DnImage::new(size_px[0], size_px[1]);
    defects.stick(&mut image);
    image
}

fn hot(place: DefectPlace, extra_e_per_s: f64) -> Defect {
    Defect { place, kind: DefectKind::Hot { extra_e_per_s } }
}

fn stuck(place: DefectPlace, dn: u16) -> Defect {
    Defect { place, kind: DefectKind::Stuck { dn } }
}

#[test]
fn defects_come_out_sorted_and_scaled_by_the_exposure() {
    let mut defects = list();
    defects.insert(hot(DefectPlace::Pixel(3, 2), 100.0)).unwrap();
    defects.insert(hot(DefectPlace::Pixel(1, 0), 50.0)).unwrap();
    let dead = Defect { place: DefectPlace::Pixel(3, 2), kind: DefectKind::Dead { response: 0.25 } };
    defects.insert(dead).unwrap();
    let frame = defects.at_frame(0, 0.5);
    let wanted = [
        Outlier { dark_e: 25.0, ..Outlier::none(1) },
        Outlier { dark_e: 50.0, response: 0.25, ..Outlier::none(2 * 64 + 3) },
    ];
    assert_eq!(frame, wanted);
}

#[test]
fn columns_and_rows_cross() {
    let mut defects = list();
    defects.insert(stuck(DefectPlace::Column(5), 100)).unwrap();
    defects.insert(stuck(DefectPlace::Row(4), 200)).unwrap();
    assert!(defects.at_frame(0, 1.0).is_empty(), "charge is as ever");
    let image = stuck_image(&defects, [64, 32]);
    assert_eq!(image.pixels().iter().filter(|dn| **dn != 0).count(), 32 + 64 - 1);
    assert_eq!(image.get(5, 0), Some(100), "the column");
    assert_eq!(image.get(0, 4), Some(200), "the row");
    assert_eq!(image.get(5, 4), Some(200), "the later one where they cross");
}

#[test]
fn a_sum_with_a_stuck_pixel_is_stuck() {
    let mut defects = Defects::new(DefectSpace { charge_binning: 3, ..SPACE }, 7, 0.1);
    defects.insert(stuck(DefectPlace::Pixel(5, 7), 100)).unwrap();
    // 64 = 21 * 3 + 1 and 32 = 10 * 3 + 2: the rest is not read.
    defects.insert(stuck(DefectPlace::Pixel(63, 31), 300)).unwrap();
    let image = stuck_image(&defects, [21, 10]);
    assert_eq!(image.get(1, 2), Some(100));
    assert_eq!(image.pixels().iter().filter(|dn| **dn != 0).count(), 1);
}

#[test]
fn removed_defects_are_gone_and_others_stay() {
    let mut defects = list();
    let column = defects.insert(stuck(DefectPlace::Column(5), 100)).unwrap();
    let pixel = defects.insert(stuck(DefectPlace::Pixel(5, 5), 300)).unwrap();
    assert!(defects.remove(pixel));
    assert!(!defects.remove(pixel), "once only");
    let image = stuck_image(&defects, [64, 32]);
    assert_eq!(image.pixels().iter().filter(|dn| **dn == 100).count(), 32, "the column alone");
    assert!(defects.remove(column));
    assert!(defects.is_empty() && stuck_image(&defects, [64, 32]).pixels().iter().all(|dn| *dn == 0));
    defects.insert(hot(DefectPlace::Row(1), 1.0)).unwrap();
    defects.clear();
    assert!(defects.at_frame(0, 1.0).is_empty() && defects.is_empty());
}

#[test]
fn the_list_never_grows_past_its_capacity() {
    let mut defects = Defects::new(DefectSpace { pixels: 40, ..SPACE }, 7, 0.1);
    let column = defects.insert(hot(DefectPlace::Column(0), 1.0)).unwrap();
    let refused = defects.insert(hot(DefectPlace::Column(1), 1.0)).unwrap_err();
    assert_eq!(refused, DefectError::Full { wanted_px: 32, held_px: 32, most_px: 40 });
    assert!(refused.to_string().contains("remove some"), "{refused}");
    assert_eq!(defects.at_frame(0, 1.0).len(), 32, "as before");
    assert!(defects.remove(column));
    defects.insert(hot(DefectPlace::Column(1), 1.0)).unwrap();
    let mut two = Defects::new(DefectSpace { defects: 2, ..SPACE }, 7, 0.1);
    let three = [0, 1, 2].map(|x| hot(DefectPlace::Pixel(x, 0), 1.0));
    assert!(matches!(two.insert_all(three), Err(DefectError::Full { .. })));
    assert_eq!(two.at_frame(0, 1.0).len(), 2, "those before it are taken");
}

#[test]
fn places_and_values_are_checked() {
    let mut defects = list();
    for place in [DefectPlace::Pixel(64, 0), DefectPlace::Pixel(0, 32), DefectPlace::Column(64), DefectPlace::Row(32)] {
        assert!(matches!(defects.insert(hot(place, 1.0)), Err(DefectError::Outside { .. })), "{place:?}");
    }
    let at = DefectPlace::Pixel(63, 31);
    for kind in [
        DefectKind::Hot { extra_e_per_s: -1.0 },
        DefectKind::Hot { extra_e_per_s: f64::NAN },
        DefectKind::Dead { response: 1.5 },
        DefectKind::Dead { response: -0.1 },
        DefectKind::Rts { extra_e_per_s: 1.0, rates: Rates { up_per_s: -1.0, down_per_s: 1.0 } },
    ] {
        let refused = defects.insert(Defect { place: at, kind });
        assert!(matches!(refused, Err(DefectError::Value { .. })), "{kind:?}");
    }
    assert!(defects.is_empty());
    defects.insert(hot(at, 1.0)).unwrap();
}

#[test]
fn a_telegraph_pixel_is_high_and_low_and_does_not_depend_on_the_others() {
    let rates = Rates { up_per_s: 2.0, down_per_s: 2.0 };
    let kind = DefectKind::Rts { extra_e_per_s: 80.0, rates };
    let rts = Defect { place: DefectPlace::Pixel(9, 9), kind };
    let mut alone = list();
    alone.insert(rts).unwrap();
    let mut crowded = list();
    crowded.insert(hot(DefectPlace::Pixel(1, 1), 3.0)).unwrap();
    crowded.insert(rts).unwrap();
    let level = |defects: &mut Defects, frame| {
        let pixel = 9 * 64 + 9;
        defects.at_frame(frame, 0.5).iter().find(|o| o.pixel == pixel).expect("listed").dark_e
    };
    let levels: Vec<f32> = (0..200).map(|frame| level(&mut alone, frame)).collect();
    let high = levels.iter().filter(|level| **level == 40.0).count();
    assert!((60..140).contains(&high), "{high} of 200 frames are high");
    assert_eq!(levels.iter().filter(|level| **level == 0.0).count(), 200 - high, "two levels only");
    for frame in [150, 3, 199, 0] {
        assert_eq!(level(&mut crowded, frame), levels[frame as usize], "frame {frame} in any order");
    }
}
