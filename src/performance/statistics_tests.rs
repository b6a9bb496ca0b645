use super::*;

fn close(got: f64, wanted: f64, within: f64) {
    assert!((got - wanted).abs() <= within, "got {got}, wanted {wanted}");
}

#[test]
fn no_failure_in_997_trials_shows_997_permille_with_95_percent() {
    // Without failures L = 1 - P^(n + 1), written out.
    for n in [10_u64, 500, 996, 997, 2000] {
        close(confidence_of(0.997, 0, n), 1.0 - 0.997_f64.powf(n as f64 + 1.0), 1e-12);
    }
    assert_eq!(fewest_trials(0.997, 0.95), 997);
    assert!(confidence_of(0.997, 1, 997) < 0.95, "one failure is too many");
    assert!(confidence_of(0.997, 0, 996) < 0.95, "one trial less is too few");
}

#[test]
fn failures_count_as_the_binomial_sum_says() {
    // I_(1-P)(k+1, n-k+1) is the chance of more than k failures in n + 1 trials: summed term by term.
    let (p, n, k) = (0.9_f64, 40_u64, 3_u64);
    let mut chance = 0.0;
    let mut term = p.powi(41);
    for i in 0..=k {
        chance += term;
        term *= (n + 1 - i) as f64 / (i + 1) as f64 * (1.0 - p) / p;
    }
    close(confidence_of(p, k, n), 1.0 - chance, 1e-12);
}

#[test]
fn tables_of_student_and_chi_square_are_met() {
    close(t_quantile(0.95, 10.0).unwrap(), 2.228_139, 1e-5);
    close(t_quantile(0.99, 4.0).unwrap(), 4.604_095, 1e-5);
    let sigma = sigma(4.0, 10.0, 0.95).unwrap();
    // Chi-square of 10 degrees of freedom: 3.246973 and 20.483177.
    close(sigma.low, (40.0_f64 / 20.483_177).sqrt(), 1e-5);
    close(sigma.high, (40.0_f64 / 3.246_973).sqrt(), 1e-5);
}

#[test]
fn shares_have_the_exact_interval() {
    let none = share(0, 20, 0.95).unwrap();
    close(none.high, 1.0 - 0.025_f64.powf(1.0 / 20.0), 1e-9);
    let all = share(20, 20, 0.95).unwrap();
    close(all.low, 0.025_f64.powf(1.0 / 20.0), 1e-9);
    assert_eq!((none.low, all.high), (0.0, 1.0));
    let half = share(8, 10, 0.95).unwrap();
    close(half.low, 0.443_904, 1e-5);
    close(half.high, 0.974_789, 1e-5);
    assert!(share(1, 0, 0.95).is_none());
}

#[test]
fn a_line_without_scatter_is_found_and_one_point_less_is_none() {
    let points: Vec<[f64; 2]> = (0..5).map(|i| [f64::from(i), 2.0 - 3.0 * f64::from(i)]).collect();
    let found = line(&points, 0.95).unwrap();
    close(found.slope.value, -3.0, 1e-12);
    close(found.at_zero, 2.0, 1e-12);
    assert!(line(&points[..2], 0.95).is_none() && line(&[[1.0, 2.0]; 5], 0.95).is_none());
}

#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let mut dice = crate::synthetic::Dice::new(11);
    let mut held = [0_u32; 4];
    for _ in 0..400 {
        let values: Vec<f64> = (0..25).map(|_| 3.0 + 2.0 * dice.normal()).collect();
        let (_, variance) = moments(&values).unwrap();
        let points: Vec<[f64; 2]> = values.iter().enumerate().map(|(i, v)| [i as f64, v + 0.5 * i as f64]).collect();
        let found = [
            (mean(&values, 0.9).unwrap(), 3.0),
            (sigma(variance, 24.0, 0.9).unwrap(), 2.0),
            (line(&points, 0.9).unwrap().slope, 0.5),
            (quantile(&values, 0.5, 0.9).unwrap(), 3.0),
        ];
        for (count, (estimate, truth)) in held.iter_mut().zip(found) {
            *count += u32::from((estimate.low..=estimate.high).contains(&truth));
        }
    }
    // 400 trials at 90 %: 360, sigma 6; the median's interval is conservative.
    assert!(held[..3].iter().all(|count| (336..=384).contains(count)), "{held:?}");
    assert!(held[3] >= 340, "{held:?}");
}
