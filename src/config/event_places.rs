//! Heads, wheels, pixels and numbers that an event names -> those that the run has.

use crate::event::{Action, Event};
use crate::{bench::Bench, check::Checker, error::Result};
use frames::sink::{CameraFault, DefectSpots, FrameFault, ImageFault, PixelFault};
use testbed::vehicle::VehicleFault;

/// Refuses an event that names what the run does not have; `key` is its place, such as `event[2]`, and `wheels` the
/// number of wheels of the spacecraft that is flown inside.
pub(super) fn check_event_places(
    event: &Event,
    key: &str,
    bench: &Bench,
    wheels: Option<usize>,
    check: &Checker<'_>,
) -> Result<()> {
    let heads = bench.head_count();
    if let Action::Frame { head, .. } | Action::Aboard(VehicleFault::TrackerOff(head)) = event.action {
        check_number(&format!("{key}.head"), head, heads, "camera heads", check)?;
    }
    if let Action::Aboard(VehicleFault::WheelFailure(wheel)) = event.action {
        check_number(&format!("{key}.wheel"), Some(wheel), wheels.unwrap_or(0), "wheels", check)?;
    }
    let Action::Frame { head, fault } = event.action else { return Ok(()) };
    let hit = (0..heads).filter(|number| head.is_none_or(|head| head == *number));
    hit.map(|number| bench.of_head(number)).try_for_each(|head| check_fault(fault, key, &head, check))
}

fn check_number(key: &str, number: Option<usize>, count: usize, what: &str, check: &Checker<'_>) -> Result<()> {
    let Some(number) = number.filter(|number| *number >= count) else { return Ok(()) };
    let wanted = format!("less than {count}, the number of {what}");
    Err(check.invalid(key, number, wanted, "they are counted from 0"))
}

/// Refuses pixels, bits and numbers beyond those of a head's detector.
fn check_fault(fault: FrameFault, key: &str, head: &Bench, check: &Checker<'_>) -> Result<()> {
    let detector = &head.camera.detector;
    let (size, bits) = ([detector.width_px, detector.height_px], detector.params.bits);
    if let Some((_, spots)) = fault.spots() {
        check_spots(&spots, key, size, check)?;
    }
    let largest_dn = (1_u32 << bits) - 1;
    match fault {
        FrameFault::Image(ImageFault::BitFlip { bit, .. }) if u32::from(bit) >= bits => {
            let wanted = format!("less than {bits}, the number of bits of the camera's detector");
            Err(check.invalid(&format!("{key}.bit"), bit, wanted, "bits are counted from 0"))
        }
        FrameFault::Camera(CameraFault::Pixels { fault: PixelFault::Stuck { dn }, .. })
            if u32::from(dn) > largest_dn =>
        {
            let wanted = format!("at most {largest_dn}, the largest number of the camera's detector");
            Err(check.invalid(&format!("{key}.dn"), dn, wanted, "digital numbers are counted from 0"))
        }
        FrameFault::Sending(_) | FrameFault::Image(_) | FrameFault::Camera(_) => Ok(()),
    }
}

fn check_spots(spots: &DefectSpots, key: &str, [width, height]: [u32; 2], check: &Checker<'_>) -> Result<()> {
    let advice = "columns and rows are counted from 0";
    let refuse = |name: &str, got: String, count: u32, what: &str| {
        Err(check.invalid(&format!("{key}.{name}"), got, format!("less than {count}, the number of {what}"), advice))
    };
    if let Some([x, y]) = spots.pixels.at.filter(|[x, y]| *x >= width || *y >= height) {
        let wanted = format!("a pixel of the detector, which has {width} x {height} pixels");
        return Err(check.invalid(&format!("{key}.px"), format!("[{x}, {y}]"), wanted, advice));
    }
    match (spots.column, spots.row) {
        (Some(column), _) if column >= width => refuse("column", column.to_string(), width, "columns"),
        (_, Some(row)) if row >= height => refuse("row", row.to_string(), height, "rows"),
        _ => Ok(()),
    }
}
