//! Levenberg-Marquardt from one start: a robust sum of squares, minimised within limits.

use super::virtual_arm::{Placed, VirtualArm, add_squares};
use super::{Settings, Target};
use nalgebra::{Cholesky, DMatrix, DVector, Point3, Vector3};

/// The loss begins this many times as wide as asked for, so that points which are still far off pull
/// too, and is halved whenever a step gets shorter than `COARSE`. Wider yet, and a false point drags
/// the arm where it stays.
const WIDER: f64 = 4.0;
/// Longest change of a variable, rad or m, in a step that ends a width; and that ends the descent.
const COARSE: f64 = 0.05;
const FINE: f64 = 1e-6;
/// Steps, those that are rejected included.
const STEPS: usize = 40;
/// After so many steps a descent is given up when its cost, in units of what a point can cost at most
/// under the loss of the moment, is above that of the best minimum so far. Most of those that end well
/// are there by then.
const PATIENCE: usize = 12;
/// The damping in units of the Hessian's largest diagonal element: at the start of each width, at
/// least, and by how much it falls and rises. It is the same for all variables: each step changes
/// them as little as it can, and so the arm stays in the branch of solutions it started in.
const DAMPING: f64 = 0.3;
const LEAST_DAMPING: f64 = 1e-9;
const DAMPING_FALLS: f64 = 0.2;
const DAMPING_RISES: f64 = 3.0;

pub(super) struct Descent<'a> {
    arm: &'a VirtualArm,
    targets: Vec<Sought>,
    /// The reference, and the weight of the square of a variable's distance from it.
    reference: DVector<f64>,
    stiffness: DVector<f64>,
    scale: f64,
    // Of the variables that were placed last.
    placed: Vec<Placed>,
    misses: Vec<Vector3<f64>>,
    // Half the gradient of the objective and half its Hessian by Gauss-Newton, where it was
    // linearised last.
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
    columns: Vec<Vector3<f64>>,
}

/// A target that was found.
struct Sought {
    point: usize,
    position: Point3<f64>,
    /// These have a mean of 1.
    weight: f64,
}

pub(super) struct Minimum {
    pub variables: DVector<f64>,
    pub cost: f64,
    /// The largest distance of a point from its target, m; 0 without targets.
    pub farthest: f64,
}

impl<'a> Descent<'a> {
    /// `reference` holds variables.
    pub fn new(
        arm: &'a VirtualArm,
        targets: &[Option<Target>],
        reference: &[f64],
        settings: &Settings,
    ) -> Self {
        let found = || {
            (0..)
                .zip(targets)
                .filter_map(|(i, target)| Some((i, (*target)?)))
        };
        let mean = found().map(|(_, target)| target.weight).sum::<f64>() / found().count() as f64;
        let sought = |(point, target): (usize, Target)| Sought {
            point,
            position: target.position,
            weight: target.weight / mean,
        };
        let targets: Vec<Sought> = found().map(sought).collect();
        let count = arm.limits.len();
        Self {
            arm,
            reference: DVector::from_column_slice(reference),
            stiffness: DVector::from_vec(arm.stiffness()) * settings.prior,
            scale: settings.scale,
            placed: Vec::new(),
            misses: vec![Vector3::zeros(); targets.len()],
            targets,
            gradient: DVector::zeros(count),
            hessian: DMatrix::zeros(count, count),
            columns: vec![Vector3::zeros(); count],
        }
    }

    /// A local minimum below `start`, both within the limits; or, when it does not promise to cost less
    /// than `best`, wherever the search was given up.
    pub fn run(&mut self, start: &[f64], best: f64) -> Minimum {
        let mut x = self.clamped(DVector::from_column_slice(start));
        let mut scale = WIDER * self.scale;
        let mut damping = DAMPING;
        self.place(&x);
        let mut cost = self.cost(&x, scale);
        self.linearise(&x, scale);
        let share = |cost: f64, scale: f64| cost / (scale * scale);
        for step in 0..STEPS {
            if step == PATIENCE && share(cost, scale) > share(best, self.scale) {
                break;
            }
            let trial = self.trial(&x, damping);
            let length = (&trial - &x).amax();
            self.place(&trial);
            let trial_cost = self.cost(&trial, scale);
            let better = trial_cost <= cost;
            if better {
                (x, cost) = (trial, trial_cost);
                damping = (damping * DAMPING_FALLS).max(LEAST_DAMPING);
            } else {
                damping *= DAMPING_RISES;
            }
            let narrower = scale > self.scale && length < COARSE;
            if !narrower && length < FINE {
                break;
            }
            if better || narrower {
                if !better {
                    self.place(&x);
                }
                if narrower {
                    scale = (scale / 2.0).max(self.scale);
                    damping = DAMPING;
                    cost = self.cost(&x, scale);
                }
                self.linearise(&x, scale);
            }
        }
        self.place(&x);
        Minimum {
            cost: self.cost(&x, self.scale),
            farthest: self.misses.iter().map(Vector3::norm).fold(0.0, f64::max),
            variables: x,
        }
    }

    fn clamped(&self, mut x: DVector<f64>) -> DVector<f64> {
        for (x, &(low, high)) in x.iter_mut().zip(&self.arm.limits) {
            *x = x.clamp(low, high);
        }
        x
    }

    fn place(&mut self, x: &DVector<f64>) {
        self.arm.place(x.as_slice(), &mut self.placed);
        for (miss, target) in self.misses.iter_mut().zip(&self.targets) {
            let point = &self.arm.points[target.point];
            *miss = self.arm.position(point, &self.placed) - target.position;
        }
    }

    /// The objective where `x` has been placed. The loss of Geman and McClure, c^2 r^2 / (c^2 + r^2),
    /// is r^2 for small r and never exceeds c^2.
    fn cost(&self, x: &DVector<f64>, scale: f64) -> f64 {
        let c2 = scale * scale;
        let loss = |(target, miss): (&Sought, &Vector3<f64>)| {
            let r2 = miss.norm_squared();
            target.weight * c2 * r2 / (c2 + r2)
        };
        let from_reference = |((x, reference), stiffness): ((&f64, &f64), &f64)| {
            stiffness * (x - reference) * (x - reference)
        };
        let held = x.iter().zip(&self.reference).zip(&self.stiffness);
        let points = self.targets.iter().zip(&self.misses);
        points.map(loss).sum::<f64>() + held.map(from_reference).sum::<f64>()
    }

    /// The objective's gradient and Hessian where `x` has been placed. To the loss' derivative by
    /// r^2 the point weighs as in plain least squares: (c^2 / (c^2 + r^2))^2.
    fn linearise(&mut self, x: &DVector<f64>, scale: f64) {
        let c2 = scale * scale;
        self.gradient.copy_from(x);
        self.gradient -= &self.reference;
        self.gradient.component_mul_assign(&self.stiffness);
        self.hessian.fill(0.0);
        self.hessian.set_diagonal(&self.stiffness);
        for (target, miss) in self.targets.iter().zip(&self.misses) {
            let point = &self.arm.points[target.point];
            let position = target.position + miss;
            (self.arm).differentiate(point, &position, &self.placed, &mut self.columns);
            let share = c2 / (c2 + miss.norm_squared());
            let weight = target.weight * share * share;
            for &variable in &point.variables {
                self.gradient[variable] += weight * self.columns[variable].dot(miss);
            }
            add_squares(&mut self.hessian, weight, point, &self.columns);
        }
        self.hessian.fill_upper_triangle_with_lower_triangle();
    }

    /// Where the damped step from `x` leads. Variables at a limit which the gradient pushes outward
    /// stay there. Variables that the step would take past a limit stop at it, and the step of the
    /// others is solved for anew, given that.
    fn trial(&self, x: &DVector<f64>, damping: f64) -> DVector<f64> {
        let limits = &self.arm.limits;
        let damping = damping * self.hessian.diagonal().max();
        // The steps that are settled.
        let mut settled: Vec<Option<f64>> = vec![None; x.len()];
        for (i, &(low, high)) in limits.iter().enumerate() {
            let g = self.gradient[i];
            if (x[i] <= low && g > 0.0) || (x[i] >= high && g < 0.0) {
                settled[i] = Some(0.0);
            }
        }
        loop {
            let mut matrix = self.hessian.clone();
            let mut step = -&self.gradient;
            for i in 0..x.len() {
                matrix[(i, i)] += damping;
                if let Some(length) = settled[i] {
                    step.axpy(-length, &self.hessian.column(i), 1.0);
                    matrix.column_mut(i).fill(0.0);
                    matrix.row_mut(i).fill(0.0);
                    matrix[(i, i)] = 1.0;
                }
            }
            for (step, settled) in step.iter_mut().zip(&settled) {
                *step = settled.unwrap_or(*step);
            }
            let Some(factors) = Cholesky::new(matrix) else {
                // Only where numbers are not finite.
                return x.clone();
            };
            factors.solve_mut(&mut step);
            let mut within = true;
            for (i, &(low, high)) in limits.iter().enumerate() {
                let end = x[i] + step[i];
                if settled[i].is_none() && !(low..=high).contains(&end) {
                    settled[i] = Some(end.clamp(low, high) - x[i]);
                    within = false;
                }
            }
            if within {
                // Rounding alone can pass a limit here.
                return self.clamped(x + step);
            }
        }
    }
}
