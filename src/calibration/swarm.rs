//! Basic particle swarm optimisation: Equations 5 and 6 and the steps of section 3.

use std::sync::atomic::{AtomicBool, Ordering};

use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::curve::ParameterVector;
use super::mpsot::{ConvergenceMonitor, Stop};
use super::settings::{Profile, Settings};

/// The coefficients of Equation 5: w, the inertia weight, and c1 = c2, the pull of the particle's own best and of the global best.
type Coefficients = (f64, f64);

/// The paper's: w = 1, c1 = c2 = 2. They diverge without a velocity limit, which the paper does not give.
const PAPER: Coefficients = (1.0, 2.0);

/// Clerc and Kennedy's constriction (IEEE Trans. Evol. Comput. 6, 2002), φ = 4.1: converges.
const CONSTRICTION: Coefficients = (0.7298, 1.49618);

/// Where a swarm searches: each scale factor in a range of its own, and each bias in a range that
/// depends on its axis' scale factor.
///
/// The objective also falls towards 0 as the scale grows without bound with the centre far outside
/// the data. So the box comes from the data: an ellipse with centre b and half-axis a·Hm that passes
/// through samples from `low` to `high` has high − a·Hm ≤ b ≤ low + a·Hm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds<const D: usize> {
    /// The axes' lowest samples without outliers, milligauss.
    pub low: [f64; D],
    /// The axes' highest samples without outliers, milligauss.
    pub high: [f64; D],
    /// Smallest scale factors.
    pub scale_min: [f64; D],
    /// Largest scale factors.
    pub scale_max: [f64; D],
    /// How far noise may have moved an extreme, milligauss.
    pub margin_mgauss: f64,
    /// Hm.
    pub reference_mgauss: f64,
}

impl<const D: usize> Bounds<D> {
    /// The range of the bias on an axis, given the scale factor there.
    pub fn bias_range(&self, axis: usize, scale: f64) -> (f64, f64) {
        let middle = 0.5 * (self.low[axis] + self.high[axis]);
        let half = 0.5 * (self.high[axis] - self.low[axis]);
        let slack = (scale * self.reference_mgauss - half).max(0.0) + self.margin_mgauss;
        (middle - slack, middle + slack)
    }

    /// Brings a position inside; a velocity that led outside is lost on that axis.
    fn confine<const P: usize>(
        &self,
        position: &mut ParameterVector<P>,
        velocity: &mut ParameterVector<P>,
    ) {
        for axis in 0..D {
            let scale = position[D + axis].clamp(self.scale_min[axis], self.scale_max[axis]);
            if scale != position[D + axis] {
                (position[D + axis], velocity[D + axis]) = (scale, 0.0);
            }
            let (least, most) = self.bias_range(axis, scale);
            let bias = position[axis].clamp(least, most);
            if bias != position[axis] {
                (position[axis], velocity[axis]) = (bias, 0.0);
            }
        }
    }

    /// The width of the box on each parameter.
    fn width<const P: usize>(&self) -> ParameterVector<P> {
        let mut width = [0.0; P];
        for axis in 0..D {
            let (least, most) = self.bias_range(axis, self.scale_max[axis]);
            width[axis] = most - least;
            width[D + axis] = self.scale_max[axis] - self.scale_min[axis];
        }
        width
    }

    fn random<const P: usize>(&self, rng: &mut impl Rng) -> ParameterVector<P> {
        let mut position = [0.0; P];
        for axis in 0..D {
            let (low, high) = (self.scale_min[axis], self.scale_max[axis]);
            let scale = low + (high - low) * rng.random::<f64>();
            let (least, most) = self.bias_range(axis, scale);
            position[D + axis] = scale;
            position[axis] = least + (most - least) * rng.random::<f64>();
        }
        position
    }
}

/// What a swarm found.
#[derive(Clone, Debug, PartialEq)]
pub struct SwarmResult<const P: usize> {
    /// The global best.
    pub position: ParameterVector<P>,
    /// Equation 8 there, milligauss².
    pub fit_value: f64,
    /// What stopped it.
    pub stop: Stop,
    /// Equation 8 at the global best after each iteration, milligauss².
    pub fit_values: Vec<f64>,
}

struct Particle<const P: usize> {
    position: ParameterVector<P>,
    velocity: ParameterVector<P>,
    best: ParameterVector<P>,
    best_fit: f64,
}

impl<const P: usize> Particle<P> {
    /// Moves on, with a velocity of at most `limit`: one pair of random numbers a particle and iteration.
    #[inline]
    fn advance(
        &mut self,
        (inertia, pull): Coefficients,
        global_best: &ParameterVector<P>,
        (r1, r2): (f64, f64),
        limit: &ParameterVector<P>,
    ) {
        for k in 0..P {
            // Equation 5.
            let velocity = inertia * self.velocity[k]
                + pull * r1 * (self.best[k] - self.position[k])
                + pull * r2 * (global_best[k] - self.position[k]);
            self.velocity[k] = velocity.clamp(-limit[k], limit[k]);
            // Equation 6.
            self.position[k] += self.velocity[k];
        }
    }
}

/// Runs a swarm in a box, until its rule or `cancelled` stops it. `start` is where one particle begins, if something good is known; the others
/// begin at random positions with random velocities within the limit. A fit value that is not a
/// number never becomes a best.
pub fn search<const D: usize, const P: usize>(
    bounds: &Bounds<D>,
    settings: &Settings,
    start: Option<ParameterVector<P>>,
    fit_value: impl Fn(&ParameterVector<P>) -> f64,
    cancelled: &AtomicBool,
) -> SwarmResult<P> {
    let coefficients = match settings.profile {
        Profile::Standard => CONSTRICTION,
        Profile::Paper => PAPER,
    };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(settings.seed);
    let largest_step = settings.velocity_limit();
    let limit = bounds.width().map(|width: f64| width * largest_step);
    let (mut global_best, mut global_fit) = (bounds.random(&mut rng), f64::INFINITY);
    let mut fit_values = Vec::new();
    let mut swarm: Vec<Particle<P>> = (0..settings.particles)
        .map(|index| {
            let mut velocity = limit.map(|limit| limit * (2.0 * rng.random::<f64>() - 1.0));
            let mut position = bounds.random(&mut rng);
            if let (0, Some(start)) = (index, start) {
                position = start;
                bounds.confine(&mut position, &mut velocity);
            }
            Particle {
                position,
                velocity,
                best: position,
                best_fit: f64::INFINITY,
            }
        })
        .collect();

    let mut watch = ConvergenceMonitor::new(settings);
    let given_up = || cancelled.load(Ordering::Relaxed).then_some(Stop::Cancelled);
    loop {
        for particle in &mut swarm {
            let fit = fit_value(&particle.position);
            if fit < particle.best_fit {
                (particle.best, particle.best_fit) = (particle.position, fit);
                if fit < global_fit {
                    (global_best, global_fit) = (particle.position, fit);
                }
            }
        }
        fit_values.push(global_fit);
        let stop = watch.iterated(&global_best, global_fit);
        if let Some(stop) = stop.or_else(given_up) {
            return SwarmResult {
                position: global_best,
                fit_value: global_fit,
                stop,
                fit_values,
            };
        }
        for particle in &mut swarm {
            let pair = (rng.random(), rng.random());
            particle.advance(coefficients, &global_best, pair, &limit);
            bounds.confine(&mut particle.position, &mut particle.velocity);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::super::settings::StopChoice;
    use super::*;

    const BOX: Bounds<2> = Bounds {
        low: [-90.0, -80.0],
        high: [110.0, 120.0],
        scale_min: [0.9, 0.9],
        scale_max: [1.5, 1.5],
        margin_mgauss: 5.0,
        reference_mgauss: 100.0,
    };

    fn standard(seed: u64) -> Settings {
        Settings {
            velocity_limit: Some(0.2),
            mean_window: Some(30),
            seed,
            ..Settings::default()
        }
    }

    fn paper(seed: u64) -> Settings {
        Settings {
            profile: Profile::Paper,
            velocity_limit: Some(0.1),
            ..standard(seed)
        }
    }

    #[test]
    fn the_velocity_is_equation_5_and_the_position_equation_6() {
        let mut particle = Particle {
            position: [2.0, 3.0],
            velocity: [1.0, -1.0],
            best: [4.0, 4.0],
            best_fit: 1.0,
        };
        particle.advance(PAPER, &[6.0, 1.0], (0.5, 0.25), &[9.0, 0.5]);
        // 1·(1, −1) + 2·0.5·((4, 4) − (2, 3)) + 2·0.25·((6, 1) − (2, 3)) = (5, −1), the second limited to 0.5.
        assert_eq!(particle.velocity, [5.0, -0.5]);
        assert_eq!(particle.position, [7.0, 2.5]);
    }

    #[test]
    fn the_box_follows_the_ellipse_through_the_extremes() {
        // Half-range 100 at Hm = 100: at scale 1 the centre is the middle, give or take the margin …
        assert_eq!(BOX.bias_range(0, 1.0), (5.0, 15.0));
        // … at 1.5 an arc may lie 50 off on either side …
        assert_eq!(BOX.bias_range(0, 1.5), (-45.0, 65.0));
        // … and below 1 only the margin is left.
        assert_eq!(BOX.bias_range(1, 0.9), (15.0, 25.0));
    }

    #[test]
    fn confined_particles_stay_inside_and_lose_their_way_out() {
        let (mut position, mut velocity) = ([500.0, 20.0, 9.0, 1.0], [3.0, 1.0, 2.0, 1.0]);
        BOX.confine(&mut position, &mut velocity);
        assert_eq!(
            (position, velocity),
            ([65.0, 20.0, 1.5, 1.0], [0.0, 1.0, 0.0, 1.0])
        );
    }

    fn bowl(position: &ParameterVector<4>) -> f64 {
        // As in the real objective, 0.01 of scale weighs as much as 1 mG.
        let (target, weight) = ([12.0, 18.0, 1.1, 1.2], [1.0, 1.0, 100.0, 100.0]);
        (0..4)
            .map(|k| (weight[k] * (position[k] - target[k])).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    #[test]
    fn constriction_converges_and_mpsot_stops_it() {
        for seed in 0..20 {
            let found = search(&BOX, &standard(seed), None, bowl, &AtomicBool::new(false));
            assert_eq!(found.stop, Stop::Change);
            assert!(
                found.fit_values.len() < 300 && found.fit_value < 0.1,
                "{found:?}"
            );
            let mut confined = found.position;
            BOX.confine(&mut confined, &mut [0.0; 4]);
            assert_eq!(confined, found.position);
        }
    }

    #[test]
    fn a_good_start_is_never_left_for_something_worse() {
        let settings = Settings {
            particles: 5,
            max_iterations: 1,
            ..standard(1)
        };
        let start = [12.1, 18.0, 1.1, 1.2];
        let found = search(&BOX, &settings, Some(start), bowl, &AtomicBool::new(false));
        assert!(found.fit_value <= bowl(&start));
    }

    #[test]
    fn a_fit_value_that_is_no_number_is_never_the_best() {
        let fit_value = |position: &ParameterVector<4>| {
            if position[0] > 10.0 {
                f64::NAN
            } else {
                bowl(position)
            }
        };
        let found = search(&BOX, &paper(1), None, fit_value, &AtomicBool::new(false));
        assert!(found.fit_value.is_finite() && found.position[0] <= 10.0);
    }

    #[test]
    fn one_that_is_cancelled_stops_after_its_iteration() {
        let settings = Settings {
            stop: StopChoice::Basic,
            max_iterations: 100_000,
            ..standard(1)
        };
        let cancelled = AtomicBool::new(false);
        let evaluated = AtomicUsize::new(0);
        let fit_value = |position: &ParameterVector<4>| {
            let count = evaluated.fetch_add(1, Ordering::Relaxed) + 1;
            cancelled.store(count > 10 * settings.particles, Ordering::Relaxed);
            bowl(position)
        };
        let found = search(&BOX, &settings, None, fit_value, &cancelled);
        assert_eq!((found.stop, found.fit_values.len()), (Stop::Cancelled, 11));
    }
}
