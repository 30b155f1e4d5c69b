//! Tells late arrivals that catch up, as buffered ones do, from those that stay late.

/// The run that is open, if one is.
#[derive(Clone, Debug)]
pub(super) struct LineLateness {
    /// Arrivals that come nearer than this, seconds, are catching up.
    step_s: f64,
    run: Option<LateRun>,
}

/// Arrivals since they caught up last.
#[derive(Clone, Copy, Debug)]
pub(super) struct LateRun {
    since_s: f64,
    from_s: f64,
    /// For how long they have been late, seconds.
    pub(super) lasts_s: f64,
    pub(super) arrivals: u32,
    /// How late they are at least, seconds.
    pub(super) least_s: f64,
}

impl LineLateness {
    pub(super) fn new(step_s: f64) -> Self {
        Self { step_s, run: None }
    }

    /// Whether it is open what the lateness means.
    pub(super) fn is_open(&self) -> bool {
        self.run.is_some()
    }

    /// An arrival came in time, or what the lateness means has been settled.
    pub(super) fn end(&mut self) {
        self.run = None;
    }

    /// An arrival came late by `late_s`.
    pub(super) fn take(&mut self, late_s: f64, arrival_s: f64) -> LateRun {
        let fresh = LateRun {
            since_s: arrival_s,
            from_s: late_s,
            lasts_s: 0.0,
            arrivals: 0,
            least_s: late_s,
        };
        let run = self.run.get_or_insert(fresh);
        if late_s < run.from_s - self.step_s {
            *run = fresh;
        }
        run.least_s = run.least_s.min(late_s);
        run.arrivals += 1;
        run.lasts_s = arrival_s - run.since_s;
        *run
    }
}
