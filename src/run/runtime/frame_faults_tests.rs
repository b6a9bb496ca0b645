//! Tests that frames are damaged as the faults demand, and that the damage is recorded.

use super::*;

fn frame() -> SentFrame {
    let mut frame = SentFrame::with_capacity(4, 4, 0, "test".into());
    frame.image.pixels_mut().fill(7);
    frame.meta.black_level_dn = 100.0;
    frame
}

fn at(ns: i64) -> Tai {
    Tai::from_ns(ns)
}

#[test]
fn a_torn_frame_has_the_upper_half_of_the_one_before() {
    let mut faults = FrameFaults::default();
    faults.add(at(5), at(9), FrameFault::Sending(SendingFault::Torn));
    let mut first = frame();
    faults.spoil(&Fate::SEND, &mut first);
    let mut second = frame();
    second.image.pixels_mut().fill(9);
    let torn = Fate { repeated: Repeated::UpperHalf, flags: FaultFlags::FRAME_TORN, ..Fate::SEND };
    faults.spoil(&torn, &mut second);
    assert_eq!(second.image.pixels()[..8], [7; 8]);
    assert_eq!(second.image.pixels()[8..], [9; 8]);
    assert!(second.meta.faults.contains(FaultFlags::FRAME_TORN));
    assert_eq!(first.image.pixels(), [7; 16], "a frame outside the fault is whole");
}

#[test]
fn a_repeated_frame_is_the_one_before() {
    let mut faults = FrameFaults::default();
    faults.add(at(5), at(9), FrameFault::Sending(SendingFault::Duplicate));
    faults.spoil(&Fate::SEND, &mut frame());
    let repeated = Fate { repeated: Repeated::All, ..Fate::SEND };
    let mut second = frame();
    second.image.pixels_mut().fill(9);
    faults.spoil(&repeated, &mut second);
    assert_eq!(second.image.pixels(), [7; 16]);
    let mut third = frame();
    third.image.pixels_mut().fill(11);
    faults.spoil(&repeated, &mut third);
    assert_eq!(third.image.pixels(), [9; 16], "what the second would have been");
}

#[test]
fn a_blank_frame_is_black_and_has_no_truth() {
    let mut faults = FrameFaults::default();
    let mut spoilt = frame();
    faults.spoil(&Fate { is_blank: true, ..Fate::SEND }, &mut spoilt);
    assert_eq!(spoilt.image.pixels(), [100; 16]);
    assert!(spoilt.truth.is_empty());
}

#[test]
fn a_fault_waits_for_its_trigger_and_comes_again_with_the_next() {
    let mut faults = FrameFaults::default();
    let begin = Begin::OnTrigger { number: 3, delay: Span::from_ns(10) };
    let waiting = faults.arm(begin, Span::from_ns(5), FrameFault::Image(ImageFault::Blank), 1);
    assert_eq!(faults.timed()[waiting].from, NEVER);
    assert_eq!(faults.fire_trigger(2, at(100)), 0, "another trigger");
    assert_eq!(faults.timed()[waiting].from, NEVER);
    assert_eq!(faults.fire_trigger(3, at(100)), 1);
    assert_eq!((faults.timed()[waiting].from, faults.timed()[waiting].until), (at(110), at(115)));
    assert_eq!(faults.fire_trigger(3, at(200)), 1, "again");
    assert_eq!(faults.timed()[waiting].from, at(210));
}

#[test]
fn one_bit_of_the_pixels_asked_for_is_the_other_way() {
    let mut faults = FrameFaults::default();
    let pixels = FaultPixels { at: Some([1, 2]), random: 2 };
    let flip = faults.add(at(5), at(9), FrameFault::Image(ImageFault::BitFlip { bit: 3, pixels }));
    let mut whole = frame();
    faults.spoil(&Fate::SEND, &mut whole);
    assert_eq!(whole.image.pixels(), [7; 16], "not yet");
    faults.timed[flip].is_on = true;
    let mut spoilt = frame();
    faults.spoil(&Fate::SEND, &mut spoilt);
    let flipped: Vec<usize> = (0..16).filter(|i| spoilt.image.pixels()[*i] == 7 ^ 8).collect();
    assert!(flipped.contains(&9) && (2..=3).contains(&flipped.len()), "{flipped:?}");
    assert!(spoilt.image.pixels().iter().all(|dn| [7, 15].contains(dn)));
    let mut other = frame();
    other.meta.number = 1;
    faults.spoil(&Fate::SEND, &mut other);
    assert_ne!(other.image.pixels(), spoilt.image.pixels(), "others in the next frame");
}

#[test]
fn false_stars_lie_where_they_were_put_and_on_the_detector() {
    let mut stars = Vec::new();
    let pixels = FaultPixels { at: Some([3, 90]), random: 500 };
    add_false_stars(&mut stars, pixels, [4.0, 1e4], [100, 120], 1, 7);
    let px = |star: &Source| match star.place {
        SourcePlace::Pixel(px) => px,
        SourcePlace::Icrf(_) => panic!("on the detector"),
    };
    assert_eq!((stars.len(), px(&stars[0]), stars[0].id), (501, [3.0, 90.0], FIRST_FALSE_STAR_ID));
    for star in &stars {
        let [x, y] = px(star);
        assert!((-0.5..99.5).contains(&x) && (-0.5..119.5).contains(&y), "{x} {y}");
    }
    let mean_x = stars.iter().map(|star| px(star)[0]).sum::<f64>() / 501.0;
    // Five sigma of the mean of 500 uniform places.
    assert!((mean_x - 49.5).abs() < 5.0 * 100.0 / (12.0_f64 * 500.0).sqrt(), "{mean_x}");
}

#[test]
fn a_ramp_has_its_ends_and_its_middle() {
    let ramp = FrameFault::Image(ImageFault::StrayLightRamp { from_e_per_s: 100.0, to_e_per_s: 300.0 });
    for (share, wanted) in [(0.0, 100.0), (0.5, 200.0), (1.0, 300.0)] {
        assert!((ramp.amount(share).value - wanted).abs() < 1e-9);
    }
}
