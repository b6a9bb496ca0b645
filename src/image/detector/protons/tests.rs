use super::*;

const SIZE: [usize; 2] = [512, 512];
const LAYER: SensitiveLayer = SensitiveLayer { thickness_um: 20.0, pixel_pitch_um: 10.0, track_width_px: 1.0 };

fn protons() -> Protons {
    Protons::new(SIZE, LAYER, 11, 1000, 100_000)
}

fn flux(direction: ProtonDirection) -> ProtonFlux {
    ProtonFlux { per_cm2_s: 200.0, energy_mev: 60.0, direction }
}

fn beam(incidence_deg: f64) -> ProtonDirection {
    ProtonDirection::Beam { incidence_deg, azimuth_deg: 30.0 }
}

/// Returns all tracks of so many frames of 0.5 s.
fn tracks(direction: ProtonDirection, frames: u32) -> Vec<ProtonTrack> {
    let mut protons = protons();
    (0..frames)
        .flat_map(|frame| {
            protons.at_frame(frame, 0.5, Some(flux(direction)));
            protons.tracks().to_vec()
        })
        .collect()
}

#[test]
fn the_rate_is_that_of_the_flux() {
    // 0.512 cm squared, 200 per cm^2 and s, 0.5 s: 26.2 through the area of a beam, half of it isotropic.
    let area_cm2 = 0.512 * 0.512;
    let frames = 400;
    for (direction, share) in [(ProtonDirection::Isotropic, 0.5), (beam(0.0), 1.0), (beam(60.0), 0.5)] {
        let mut protons = protons();
        assert!((protons.area_cm2() - area_cm2).abs() < 1e-12);
        let counts: Vec<f64> = (0..frames)
            .map(|frame| {
                protons.at_frame(frame, 0.5, Some(flux(direction)));
                protons.tracks().len() as f64
            })
            .collect();
        let wanted = 200.0 * area_cm2 * share * 0.5;
        let mean = counts.iter().sum::<f64>() / f64::from(frames);
        let variance = counts.iter().map(|n| (n - mean) * (n - mean)).sum::<f64>() / f64::from(frames - 1);
        let sigma = (wanted / f64::from(frames)).sqrt();
        assert!((mean - wanted).abs() < 5.0 * sigma, "{direction:?}: {mean} for {wanted}");
        // Poisson: variance is the mean; its own spread is sqrt(2 / n) and a little more.
        assert!((variance / wanted - 1.0).abs() < 5.0 * (2.1 / f64::from(frames)).sqrt(), "{variance} for {wanted}");
        assert!((mean - 1.1 * wanted).abs() > 5.0 * sigma || share < 1.0, "negative control");
    }
}

#[test]
fn the_mean_deposit_follows_the_formula() {
    // By hand for 60 MeV straight through 20 um: 8.561 MeV cm^2/g * 2.33 g/cm^3 * 20e-4 cm = 39.89 keV; / 3.65 eV.
    let wanted = 8.561 * 2.33 * 20e-4 * 1e6 / 3.65;
    let all = tracks(beam(0.0), 200);
    let n = all.len() as f64;
    let mean = all.iter().map(|t| t.electrons).sum::<f64>() / n;
    let spread = (all.iter().map(|t| (t.electrons - mean).powi(2)).sum::<f64>() / n).sqrt();
    assert!((mean - wanted).abs() < 5.0 * spread / n.sqrt(), "{mean} for {wanted}");
    // Bohr: 0.157 MeV^2 Z/A rho x, a little more by relativity (gamma 1.064).
    let bohr_e = (0.1569_f64 * 0.4985 * 2.33 * 20e-4).sqrt() * 1e6 / 3.65;
    assert!((spread / (bohr_e * 1.04) - 1.0).abs() < 0.2, "{spread} for {bohr_e}");
    assert!((mean - 1.1 * wanted).abs() > 5.0 * spread / n.sqrt(), "negative control");
}

#[test]
fn isotropic_tracks_follow_the_cosine_law() {
    let all = tracks(ProtonDirection::Isotropic, 800);
    let length = |t: &ProtonTrack| (t.end_px[0] - t.start_px[0]).hypot(t.end_px[1] - t.start_px[1]) * 10.0;
    // Those well inside, whose ends are not cut: tan(angle) = length / thickness.
    let inside = |t: &&ProtonTrack| t.start_px.iter().all(|at| (100.0..412.0).contains(at));
    let mu2: Vec<f64> = all.iter().filter(inside).map(|t| 1.0 / (1.0 + (length(t) / 20.0).powi(2))).collect();
    let n = mu2.len() as f64;
    // p(mu) = 2 mu: mu^2 is uniform.
    let mean = mu2.iter().sum::<f64>() / n;
    let second = mu2.iter().map(|m| m * m).sum::<f64>() / n;
    assert!((mean - 0.5).abs() < 5.0 * (1.0_f64 / 12.0 / n).sqrt(), "{mean}");
    assert!((second - 1.0 / 3.0).abs() < 5.0 * (4.0_f64 / 45.0 / n).sqrt(), "{second}");
    // Angles on the image: no preferred direction, to five standard errors.
    let turn = |of: fn(f64) -> f64| {
        all.iter().map(|t| of((t.end_px[1] - t.start_px[1]).atan2(t.end_px[0] - t.start_px[0]))).sum::<f64>()
            / all.len() as f64
    };
    let limit = 5.0 * (0.5 / all.len() as f64).sqrt();
    assert!(turn(f64::cos).abs() < limit && turn(f64::sin).abs() < limit);
    assert!((mu2.iter().map(|m| m.sqrt()).sum::<f64>() / n - 0.5).abs() > 0.1, "a uniform cosine would be seen");
}

#[test]
fn a_slanted_beam_has_longer_tracks() {
    let all = tracks(beam(60.0), 50);
    let track = all.iter().find(|t| t.start_px.iter().all(|at| (50.0..450.0).contains(at))).expect("one inside");
    let (dx, dy) = (track.end_px[0] - track.start_px[0], track.end_px[1] - track.start_px[1]);
    assert!((dx.hypot(dy) - 2.0 * 3.0_f64.sqrt()).abs() < 1e-9, "20 um tan 60 deg is 34.6 um");
    assert!((dy.atan2(dx).to_degrees() - 30.0).abs() < 1e-9);
}

#[test]
fn charge_is_what_the_tracks_say() {
    let mut protons = protons();
    for frame in 0..20 {
        let list = protons.at_frame(frame, 0.5, Some(flux(ProtonDirection::Isotropic))).to_vec();
        assert!(list.windows(2).all(|w| w[0].pixel < w[1].pixel), "sorted, one each");
        let charge_e: f64 = list.iter().map(|o| f64::from(o.charge_e)).sum();
        let inside = |t: &&ProtonTrack| [t.start_px, t.end_px].iter().flatten().all(|at| (0.0..511.0).contains(at));
        let all: f64 = protons.tracks().iter().map(|t| t.electrons).sum();
        let whole: f64 = protons.tracks().iter().filter(inside).map(|t| t.electrons).sum();
        assert!(charge_e <= all * (1.0 + 1e-6) && charge_e >= whole * (1.0 - 1e-6), "{whole} {charge_e} {all}");
    }
}

#[test]
fn frames_repeat_and_the_excess_is_counted() {
    let mut few = Protons::new(SIZE, LAYER, 11, 4, 10_000);
    let many = Some(flux(beam(0.0)));
    let first = few.at_frame(3, 0.5, many).to_vec();
    assert_eq!(few.tracks().len(), 4, "bounded");
    assert!((10..=40).contains(&few.left_out()), "about 22: {}", few.left_out());
    assert_ne!(few.at_frame(4, 0.5, many), first, "another frame");
    assert_eq!(few.at_frame(3, 0.5, many), first, "the same again");
    assert!(few.at_frame(5, 0.5, None).is_empty() && few.tracks().is_empty());
}

#[test]
fn fluxes_without_a_meaning_are_refused() {
    let mut protons = protons();
    let good = flux(ProtonDirection::Isotropic);
    for bad in [
        ProtonFlux { per_cm2_s: -1.0, ..good },
        ProtonFlux { per_cm2_s: f64::NAN, ..good },
        ProtonFlux { energy_mev: 0.5, ..good },
        ProtonFlux { energy_mev: 2e4, ..good },
        ProtonFlux { direction: beam(90.0), ..good },
        ProtonFlux { direction: ProtonDirection::Beam { incidence_deg: 0.0, azimuth_deg: f64::INFINITY }, ..good },
    ] {
        let refused = bad.checked().unwrap_err();
        assert!(refused.to_string().contains("wanted"), "{refused}");
        assert!(protons.at_frame(1, 0.5, Some(bad)).is_empty(), "a flux that is refused draws nothing: {bad:?}");
    }
    assert!(!protons.at_frame(1, 0.5, Some(good)).is_empty(), "control");
    assert!(protons.at_frame(1, 0.5, Some(ProtonFlux { per_cm2_s: 0.0, ..good })).is_empty(), "no flux is none");
    assert!(ProtonFlux { energy_mev: 1.0, ..good }.checked().is_ok());
}
