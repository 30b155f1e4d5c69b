use super::*;
use proptest::prelude::*;

#[test]
fn the_direct_sum_is_equation_8() {
    // Hm = 5; at (7, 8) with b = (1, 0), a = (2, 2): H = (3, 4), ΔH = 0.
    // At (1, 2): H = (0, 1), ΔH = 24. At (3, 0): H = (1, 0), ΔH = 24.
    let position = [1.0, 0.0, 2.0, 2.0];
    let points = [[7.0, 8.0], [1.0, 2.0], [3.0, 0.0]];
    assert!((direct(&points, &position, 5.0) - (2.0f64 * 24.0 * 24.0).sqrt()).abs() < 1e-12);
}

fn ellipse(
    count: usize,
    position: &[f64; 6],
    noise: impl Fn(usize, usize) -> f64,
) -> Vec<[f64; 3]> {
    (0..count)
        .map(|i| {
            let (t, s) = (i as f64 * 0.37, i as f64 * 0.011);
            let h = [t.cos() * s.cos(), t.sin() * s.cos(), s.sin()];
            std::array::from_fn(|k| h[k] * 500.0 * position[3 + k] + position[k] + noise(i, k))
        })
        .collect()
}

/// Bias of up to 20 times the field, scale factors, how far off a second position is, and a seed.
type Drawn = ([f64; 3], [f64; 3], [f64; 6], usize);

fn drawn() -> impl Strategy<Value = Drawn> {
    (
        prop::array::uniform3(-10_000.0..10_000.0f64),
        prop::array::uniform3(0.3..3.0f64),
        prop::array::uniform6(0.9..1.1f64),
        0usize..1000,
    )
}

/// Noisy points of the drawn ellipsoid, its parameters, and others near to them.
fn noisy((bias, scale, off, seed): Drawn) -> (Vec<[f64; 3]>, [f64; 6], [f64; 6]) {
    let truth = [bias[0], bias[1], bias[2], scale[0], scale[1], scale[2]];
    let noise = |i: usize, k: usize| {
        let x = (seed + 1)
            .wrapping_mul(i * 3 + k + 1)
            .wrapping_mul(2_654_435_761);
        6.0 * ((x >> 7 & 0xffff) as f64 / 65536.0 - 0.5)
    };
    let near = std::array::from_fn(|k| {
        if k < 3 {
            truth[k] + 300.0 * (off[k] - 1.0)
        } else {
            truth[k] * off[k]
        }
    });
    (ellipse(400, &truth, noise), truth, near)
}

fn factored<const D: usize, const F: usize>(points: &[[f64; D]]) -> Factored<D, F> {
    let extreme = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| {
        points.iter().map(|point| point[axis]).fold(start, pick)
    };
    let low = std::array::from_fn(|axis| extreme(axis, f64::MAX, f64::min));
    let high = std::array::from_fn(|axis| extreme(axis, f64::MIN, f64::max));
    Factored::new(Normalizer::new(&low, &high), points, 500.0)
}

proptest! {
    #[test]
    fn factor_and_direct_sum_agree(drawn in drawn()) {
        let (points, truth, near) = noisy(drawn);
        let plane: Vec<[f64; 2]> = points.iter().map(|p| [p[0], p[1]]).collect();
        let (in_space, in_plane) = (factored::<3, 7>(&points), factored::<2, 5>(&plane));
        for p in [truth, near] {
            let level = [p[0], p[1], p[3], p[4]];
            for (a, b) in [
                (direct(&points, &p, 500.0), in_space.fit_value(&p)),
                (direct(&plane, &level, 500.0), in_plane.fit_value(&level)),
            ] {
                prop_assert!((a - b).abs() <= 1e-9 * a, "{a} {b}");
            }
        }
    }
}

#[test]
fn the_conic_is_exact_without_noise() {
    let truth = [87.28, 54.19, 135.0, 0.873, 0.998, 0.94];
    let points = ellipse(300, &truth, |_, _| 0.0);
    let normal = Normalizer::new(&[-400.0; 3], &[600.0; 3]);
    let conic: [f64; 6] = Factored::<3, 7>::new(normal, &points, 500.0)
        .conic()
        .unwrap();
    for (found, true_value) in conic.iter().zip(truth) {
        assert!((found - true_value).abs() < 1e-6, "{conic:?}");
    }
}

#[test]
fn the_conic_finds_soft_iron() {
    let truth = [87.28, 54.19, 135.0, 0.873, 0.998, 0.94, 0.1, -0.04, 0.06];
    let matrix = curve::matrix::<3>(&truth[3..]);
    let bias = SVector::from([truth[0], truth[1], truth[2]]);
    let points: Vec<[f64; 3]> = ellipse(300, &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0], |_, _| 0.0)
        .into_iter()
        .map(|h| (matrix * SVector::from(h) + bias).into())
        .collect();
    let conic: [f64; 9] = factored::<3, 10>(&points).conic().unwrap();
    for (found, true_value) in conic.iter().zip(truth) {
        assert!((found - true_value).abs() < 1e-6, "{conic:?}");
    }
}

#[test]
fn a_constant_axis_gives_no_conic_and_no_nan() {
    let points: Vec<[f64; 2]> = (0..50).map(|i| [f64::from(i), 3.0]).collect();
    let factored =
        Factored::<2, 5>::new(Normalizer::new(&[0.0, 3.0], &[49.0, 3.0]), &points, 100.0);
    assert_eq!(factored.conic::<4>(), None);
    assert!(factored.fit_value(&[25.0, 3.0, 1.0, 1.0]).is_finite());
}
