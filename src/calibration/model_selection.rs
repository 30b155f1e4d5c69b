//! Model selection: a diagonal or a symmetric A, by whether the samples show soft iron.

use super::curve::Curve;
use super::fit::{self, Fitted};
use super::refine::Refined;
use super::settings::ModelChoice;
use super::uncertainty::correlation_length;

/// Where the three cross terms make a bias this many times less certain, the motion cannot separate them from it.
/// Turns about two clearly different axes make it 2 times; rolls at one heading, which show the cross terms by
/// the wobble of a hand alone, 11.
const UNSEEN: f64 = 5.0;

/// Whether the samples show off-diagonal entries of A.
pub enum SoftIron {
    /// They are there, or were asked for.
    Found(Box<Fitted<3, 9>>),
    /// They would have been seen, and are not there; or the model is given as diagonal.
    None,
    /// This motion cannot separate them from the biases.
    Unseen,
}

/// The symmetric model, where the evidence asks for it: started from the linear conic.
///
/// The evidence is Schwarz's criterion (Annals of Statistics 6, 1978), n·ln σ² + k·ln n, with the samples
/// counted for what their correlated residuals are worth: three more parameters must lower the residual by
/// more than chance would. And all nine must have been seen: where a motion leaves one of them open, the
/// uncertainty of the biases shows it, and the diagonal model is kept.
pub fn select_model(
    diagonal: &Fitted<3, 6>,
    reference_given: bool,
    choice: ModelChoice,
) -> SoftIron {
    if choice == ModelChoice::Diagonal {
        return SoftIron::None;
    }
    let (points, reference) = (&diagonal.points, diagonal.best.reference_mgauss);
    let symmetric = fit::conic(points, reference)
        .and_then(|start| fit::refine_and_normalize(points, &start, reference, reference_given));
    let Some(best) = symmetric else {
        return SoftIron::Unseen;
    };
    let seen = bias_doubt(&best) < UNSEEN * bias_doubt(&diagonal.best);
    let asked_for = || {
        let curve = Curve::<3, 9>::new(&best.position, best.reference_mgauss)?;
        let residuals = points
            .iter()
            .map(|point| curve.distance(point).value_mgauss);
        let residuals: Vec<f64> = residuals.collect();
        let n = residuals.len() as f64 / correlation_length(&residuals);
        let gain = 2.0 * n * (diagonal.best.residual_mgauss / best.residual_mgauss).ln();
        Some(gain > 3.0 * n.ln())
    };
    if choice == ModelChoice::Symmetric || (seen && asked_for() == Some(true)) {
        SoftIron::Found(Box::new(Fitted {
            points: diagonal.points.clone(),
            level: diagonal.level,
            best,
        }))
    } else if seen {
        SoftIron::None
    } else {
        SoftIron::Unseen
    }
}

/// How uncertain the least certain bias is, over the noise.
fn bias_doubt<const P: usize>(refined: &Refined<P>) -> f64 {
    let variance = (0..3)
        .map(|k| refined.covariance[(k, k)])
        .fold(0.0, f64::max);
    variance.sqrt() / refined.residual_mgauss
}
