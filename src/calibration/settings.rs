//! What can be set of a calibration.

use crate::check::{settings, words};

words! {
    /// Which parameters to look for.
    #[derive(Default)]
    pub enum ModeChoice {
        /// Three axes where turns about two clearly different axes allow it, else the plane of the turn.
        #[default]
        Auto = "auto",
        /// The plane of the turn.
        Planar = "planar",
        /// All three axes.
        Spatial = "spatial",
    }
}

words! {
    /// The shape of A in space.
    #[derive(Default)]
    pub enum ModelChoice {
        /// Symmetric where the evidence asks for it, else diagonal.
        #[default]
        Auto = "auto",
        /// A scale factor an axis: the paper's model.
        Diagonal = "diagonal",
        /// Soft iron and cross-coupling too.
        Symmetric = "symmetric",
    }
}

words! {
    /// A set of swarm coefficients.
    #[derive(Default)]
    pub enum Profile {
        /// Constriction, one particle started at the linear conic fit, the objective through its
        /// triangular factor.
        #[default]
        Standard = "standard",
        /// The paper's: w = 1, c1 = c2 = 2, every particle at random, the direct sum of Equation 8.
        Paper = "paper",
    }
}

words! {
    /// Which samples the swarm sees.
    #[derive(Default)]
    pub enum WindowChoice {
        /// RIST's range of interest, inside full turns.
        #[default]
        Rist = "rist",
        /// Everything from the start of the first turn to the end of the last.
        Turn = "turn",
        /// Every sample there is.
        All = "all",
    }
}

words! {
    /// When the swarm stops.
    #[derive(Default)]
    pub enum StopChoice {
        /// MPSOT's three levels.
        #[default]
        Mpsot = "mpsot",
        /// At the maximum number of iterations, or at the minimum error.
        Basic = "basic",
    }
}

settings! {
    /// Settings of a calibration.
    pub struct Settings {
        /// Planar, spatial, or whichever the turns allow.
        mode: ModeChoice = ModeChoice::Auto;
        /// The shape of A in space.
        model: ModelChoice = ModelChoice::Auto;
        /// The swarm's coefficients.
        profile: Profile = Profile::Standard;
        /// The samples that the swarm sees.
        window: WindowChoice = WindowChoice::Rist;
        /// The swarm's stopping rule.
        stop: StopChoice = StopChoice::Mpsot;
        /// N, the number of particles. 30 is common practice; the paper gives none.
        particles: usize = 30, 2..=1000, "";
        /// Level 1 of MPSOT.
        max_iterations: usize = 1000, 1..=100_000, "";
        /// Level 2: the fit value (Equation 8, milligauss²) at which the swarm stops. 0 leaves it to the others.
        min_error_mgauss2: f64 = 0.0, 0.0..=1e12, "milligauss squared";
        /// Level 3: the change of a parameter (milligauss, or scale factor) that counts as none. The paper: 0.01.
        min_change: f64 = 0.01, 0.0..=10.0, "";
        /// L, the iterations over which level 3 takes its mean. The paper gives none. Left out, it is
        /// the profile's: see [`Settings::mean_window()`].
        mean_window: Option<usize> = None, 2..=1000, "iterations";
        /// Largest step of a particle, as a fraction of the box. The paper gives none. Left out, it
        /// is the profile's: see [`Settings::velocity_limit()`].
        velocity_limit: Option<f64> = None, 0.001..=1.0, "of the box";
        /// Strength of the horizontal field, milligauss, if known: the reference of a planar calibration.
        horizontal_mgauss: Option<f64> = None, 10.0..=1000.0, "milligauss";
        /// Strength of the whole field, milligauss, if known: the reference of a spatial calibration.
        total_mgauss: Option<f64> = None, 10.0..=1000.0, "milligauss";
        /// Turns whose axes differ by this angle or more, degrees, allow a spatial calibration.
        axes_apart_deg: f64 = 45.0, 20.0..=90.0, "degrees";
        /// Seed of the swarm. The same samples and seed give the same parameters.
        seed: u64 = 1;
    }
}

impl Settings {
    /// Largest step of a particle, as a fraction of the box.
    ///
    /// Constriction converges by itself, and 0.05 of a box this narrow only keeps the first steps short. The
    /// paper's w = 1 never slows down: its particles swing about the best by as much as the limit lets
    /// them. On the paper's tests made again, 1000 iterations end 0.11 mG RMS from the truth in space with a
    /// limit of 0.01, 0.66 with 0.02 and 1.0 with 0.05; with 0.005 the swarm crosses its box too slowly.
    pub fn velocity_limit(&self) -> f64 {
        self.velocity_limit.unwrap_or(match self.profile {
            Profile::Standard => 0.05,
            Profile::Paper => 0.01,
        })
    }

    /// L, at least 1.
    ///
    /// The global best stands still for several iterations now and then. With constriction 15 outlast nearly
    /// all such pauses. A swarm that swings about finds something better more seldom: at L = 15, one in four
    /// stops more than 5 mG off in space; at 60 all end within 1 mG, after 110 to 160 iterations on average
    /// and at most 210.
    pub fn mean_window(&self) -> usize {
        self.mean_window.unwrap_or(match self.profile {
            Profile::Standard => 15,
            Profile::Paper => 60,
        })
    }
}
