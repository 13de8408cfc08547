//! The cone that fits best: a start for the best of some axes, which Levenberg and Marquardt's method then improves.
//!
//! A cone is given by its axis, the foot of the mean on it, its radius r there, and its slope t, the tangent of half
//! the opening angle: Q = ρ² − R² with ρ the distance from the axis, R = r + t·z, and z the place along the axis.
//! Taubin's mean square is mean Q² / mean |∇Q|². Q and its derivatives by the six numbers of a cone are polynomials of
//! degree 2, so that all of this is exact from moments up to degree 4, and no face is looked at.

use glam::DVec3;

use super::{Fit, Known, SMALLEST_RADIUS};
use crate::shapes::central::{Central, CentralHigher, matrix};
use crate::shapes::eigen::smallest;
use crate::shapes::monomials::{PAIRS, place};
use crate::shapes::shape::{Shape, across};

/// A smaller slope is that of a cylinder: 0.45°.
const LEAST_SLOPE: f64 = 1.0 / 128.0;

/// A larger one is that of a plane: 88.2°.
const LARGEST_SLOPE: f64 = 32.0;

/// No radius at the mean is larger, in units of moments, so that proxies reach the axis.
const LARGEST_RADIUS: f64 = (1u64 << 24) as f64;

/// Steps at most, those that do not lower the mean square among them.
const STEPS: usize = 24;

/// Damping of the first step, and by what it grows after a step in vain and falls after another. Short arcs say little
/// of some numbers, and steps without damping go too far.
const DAMPING: f64 = 1e-6;
const FACTOR: f64 = 16.0;

/// With more damping, steps are too short to lower the mean square by much.
const MOST_DAMPING: f64 = 0.01;

/// A step that lowers the mean square by a smaller part is the last.
const LEAST_GAIN: f64 = 1e-4;

/// The apex is beside the cluster: the mean square distance from it along the axis, over the variance along it. Without
/// that, both halves of a double cone would be one shape.
const APART: f64 = 2.0;

/// Numbers of a cone.
const NUMBERS: usize = 6;

pub(super) fn fit(Known { central, higher, axes }: Known<'_>) -> Option<Fit> {
    let length = central.variance().sqrt();
    if length <= 0.0 {
        return None;
    }
    let moments = Scaled::of(central, higher, length);
    // normals of a cone have one component along its axis
    let normal = DVec3::from(higher.normal);
    let about_mean = std::array::from_fn(|at| {
        let [a, b] = PAIRS[at];
        higher.normals[at] - normal[a] * normal[b]
    });
    let (_, axis) = smallest(matrix(&about_mean));
    let axes = [DVec3::from(axis)].into_iter().chain(axes.iter().copied());
    let starts = axes.filter_map(|axis| around(&moments, axis, normal)).map(|cone| (cone.mean_square(&moments), cone));
    let (mut least, mut cone) = starts.reduce(|best, start| if start.0 < best.0 { start } else { best })?;
    let mut damping = DAMPING;
    let mut equations = cone.equations(&moments);
    for _ in 0..STEPS {
        let next = equations.solved(damping).map(|step| cone.stepped(step));
        let next = next.map(|next| (next.mean_square(&moments), next));
        let Some((after, next)) = next.filter(|&(after, _)| after < least) else {
            damping *= FACTOR;
            if damping > MOST_DAMPING {
                break;
            }
            continue;
        };
        let is_last = after > least * (1.0 - LEAST_GAIN);
        (least, cone, damping) = (after, next, damping / FACTOR);
        if is_last {
            break;
        }
        equations = cone.equations(&moments);
    }
    let Cone { foot, axis, radius, slope } = cone.upright();
    let beside = (radius / slope) * (radius / slope) >= APART * moments.along(axis);
    let is_one = least.is_finite()
        && (LEAST_SLOPE..=LARGEST_SLOPE).contains(&slope)
        && (SMALLEST_RADIUS..=LARGEST_RADIUS).contains(&(radius * length))
        && beside;
    let apex = central.mean + (foot - radius / slope * axis) * length;
    is_one.then_some(Fit { shape: Shape::Cone { apex, axis, slope }, mean_square: least.max(0.0) * length * length })
}

/// A polynomial of degree 2: the coefficients of 1, of the coordinates, and of their products.
type Quadratic = [f64; 10];

/// A linear one.
type Linear = (f64, DVec3);

fn product((a, x): Linear, (b, y): Linear) -> Quadratic {
    let mut all = [a * b, a * y.x + b * x.x, a * y.y + b * x.y, a * y.z + b * x.z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for (sum, [i, j]) in all[4..].iter_mut().zip(PAIRS) {
        *sum = if i == j { x[i] * y[i] } else { x[i] * y[j] + x[j] * y[i] };
    }
    all
}

/// A polynomial and so many times another.
fn plus(a: Quadratic, times: f64, b: Quadratic) -> Quadratic {
    std::array::from_fn(|at| a[at] + times * b[at])
}

fn times(by: f64, a: Quadratic) -> Quadratic {
    a.map(|x| by * x)
}

fn dot(a: &Quadratic, b: &Quadratic) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (x, y)| sum + x * y)
}

/// Means of products of two of [`Quadratic`]'s terms, about the mean, in units of a length.
struct Scaled {
    of: [Quadratic; 10],
}

impl Scaled {
    fn of(central: &Central, higher: &CentralHigher, length: f64) -> Self {
        let per = 1.0 / length;
        let [second, third, fourth] = [2, 3, 4].map(|degree| (1..degree).fold(per, |power, _| power * per));
        let second = central.second.map(|mean| mean * second);
        let third = higher.third.map(|mean| mean * third);
        let fourth = higher.fourth.map(|mean| mean * fourth);
        let mut of = [[0.0; 10]; 10];
        of[0][0] = 1.0;
        of[0][4..].copy_from_slice(&second);
        for (i, [a, b]) in PAIRS.into_iter().enumerate() {
            of[4 + i][0] = second[i];
            (of[1 + a][1 + b], of[1 + b][1 + a]) = (second[i], second[i]);
            for axis in 0..3 {
                let mean = third[place([axis, a, b])];
                (of[1 + axis][4 + i], of[4 + i][1 + axis]) = (mean, mean);
            }
            for (j, [c, d]) in PAIRS.into_iter().enumerate() {
                of[4 + i][4 + j] = fourth[place([a, b, c, d])];
            }
        }
        Self { of }
    }

    fn mean(&self, of: &Quadratic) -> f64 {
        dot(&self.of[0], of)
    }

    /// The means of a polynomial times each term: the matrix is symmetric, and sums of rows are vector operations.
    fn with(&self, of: &Quadratic) -> Quadratic {
        self.of.iter().zip(of).fold([0.0; 10], |sums, (row, &times)| plus(sums, times, *row))
    }

    /// The variance along an axis.
    fn along(&self, axis: DVec3) -> f64 {
        self.mean(&product((0.0, axis), (0.0, axis)))
    }
}

/// A cone; lengths from the mean, in units of [`Scaled`].
#[derive(Clone, Copy)]
struct Cone {
    /// The foot of the mean on the axis.
    foot: DVec3,
    axis: DVec3,
    /// The radius there.
    radius: f64,
    slope: f64,
}

/// The start around an axis of this direction. The slope is that of the mean normal; the rest is as for cylinders, by
/// the smallest eigenvalue of the covariance of (ζ, y), ζ = (P − mean P) / √mean |∇P|² with P = |y|² − (1 + t²)·z².
fn around(moments: &Scaled, axis: DVec3, normal: DVec3) -> Option<Cone> {
    let sine = normal.dot(axis).abs();
    let slope = (sine / (1.0 - sine * sine).max(0.0).sqrt()).clamp(LEAST_SLOPE, LARGEST_SLOPE);
    let square = slope * slope;
    let mut of = times(-(1.0 + square), product((0.0, axis), (0.0, axis)));
    [4, 7, 9].into_iter().for_each(|at| of[at] += 1.0);
    let variance = moments.mean(&[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
    let (mean, with) = (moments.mean(&of), moments.with(&of));
    let scale = 2.0 * (variance + (square * square - 1.0) * moments.along(axis)).sqrt();
    let mut all = [[0.0; 4]; 4];
    all[0][0] = (dot(&with, &of) - mean * mean) / (scale * scale);
    for i in 0..3 {
        all[0][i + 1] = with[i + 1] / scale;
        all[i + 1][0] = with[i + 1] / scale;
        all[i + 1][1..].copy_from_slice(&moments.of[i + 1][1..4]);
    }
    let (_, [zeta, rest @ ..]) = smallest(all);
    let rest = DVec3::from(rest) * (scale / zeta);
    let along = rest.dot(axis);
    let foot = (along * axis - rest) / 2.0;
    let radius = (foot.dot(foot) + mean).sqrt();
    // of the two directions, the one in which the radius grows
    let axis = if along > 0.0 { -axis } else { axis };
    radius.is_finite().then_some(Cone { foot, axis, radius, slope })
}

impl Cone {
    /// The numbers of the distance: two across the axis, the place along it, and the radius there.
    fn linear(&self) -> [Linear; 4] {
        let u = across(self.axis);
        let v = self.axis.cross(u);
        let [x, y, z] = [u, v, self.axis].map(|along| (-along.dot(self.foot), along));
        [x, y, z, (self.radius + self.slope * z.0, self.slope * self.axis)]
    }

    fn mean_square(&self, moments: &Scaled) -> f64 {
        let [x, y, _, radius] = self.linear();
        let (across, radius) = (plus(product(x, x), 1.0, product(y, y)), product(radius, radius));
        let of = plus(across, -1.0, radius);
        let gradient = plus(across, self.slope * self.slope, radius);
        dot(&moments.with(&of), &of) / (4.0 * moments.mean(&gradient))
    }

    /// The equations of a step.
    fn equations(&self, moments: &Scaled) -> Equations {
        let slope = self.slope;
        let [x, y, z, r] = self.linear();
        let square = slope * slope;
        let one = (1.0, DVec3::ZERO);
        let (across_axis, of_radius) = (plus(product(x, x), 1.0, product(y, y)), product(r, r));
        let of = plus(across_axis, -1.0, of_radius);
        let gradient = moments.mean(&plus(across_axis, square, of_radius));
        // the derivatives of Q, and of |∇Q|²/4, by the foot across the axis, the axis in the same directions, the
        // radius and the slope
        let turn = |by: f64| (z.0 + by * r.0, z.1 + by * r.1);
        let with_radius = product(z, r);
        let derivatives = [
            [times(-2.0, product(x, one)); 2],
            [times(-2.0, product(y, one)); 2],
            [slope, -square * slope].map(|by| times(-2.0, product(x, turn(by)))),
            [slope, -square * slope].map(|by| times(-2.0, product(y, turn(by)))),
            [-2.0, 2.0 * square].map(|by| times(by, product(r, one))),
            [times(-2.0, with_radius), plus(times(2.0 * slope, of_radius), 2.0 * square, with_radius)],
        ];
        // those of Q / √mean |∇Q|², but for that root
        let slopes =
            derivatives.map(|[value, of_gradient]| plus(value, -moments.mean(&of_gradient) / (2.0 * gradient), of));
        let with = slopes.each_ref().map(|slope| moments.with(slope));
        let mut products = [[0.0; NUMBERS]; NUMBERS];
        for (at, row) in products.iter_mut().enumerate() {
            row.iter_mut().zip(&slopes[..=at]).for_each(|(product, slope)| *product = dot(&with[at], slope));
        }
        Equations { products, right: with.map(|with| -dot(&with, &of)) }
    }

    /// The cone after a step.
    fn stepped(&self, [by_u, by_v, turn_u, turn_v, by_radius, by_slope]: [f64; NUMBERS]) -> Self {
        let Self { foot, axis, radius, slope } = *self;
        let u = across(axis);
        let v = axis.cross(u);
        let turned = axis + turn_u * u + turn_v * v;
        let axis = turned / turned.length();
        let moved = foot + by_u * u + by_v * v;
        let along = moved.dot(axis);
        let slope = slope + by_slope;
        Self { foot: moved - along * axis, axis, radius: radius + by_radius - slope * along, slope }
    }

    /// The same cone, whose radius grows along the axis.
    fn upright(self) -> Self {
        if self.slope < 0.0 { Self { axis: -self.axis, slope: -self.slope, ..self } } else { self }
    }
}

/// The equations of a step of the least squares: a positive definite matrix, of which the lower half counts, and the
/// right side.
struct Equations {
    products: [[f64; NUMBERS]; NUMBERS],
    right: [f64; NUMBERS],
}

impl Equations {
    /// The step with this damping; none if the matrix is not positive definite (Cholesky).
    fn solved(&self, damping: f64) -> Option<[f64; NUMBERS]> {
        let Self { mut products, mut right } = *self;
        products.iter_mut().enumerate().for_each(|(at, row)| row[at] *= 1.0 + damping);
        for i in 0..NUMBERS {
            for j in 0..=i {
                let less = (0..j).fold(products[i][j], |sum, k| sum - products[i][k] * products[j][k]);
                products[i][j] = match i == j {
                    // NaN is refused, too
                    true if less > products[i][i] * 1e-13 => less.sqrt(),
                    true => return None,
                    false => less / products[j][j],
                };
            }
        }
        for i in 0..NUMBERS {
            let less = (0..i).fold(right[i], |sum, k| sum - products[i][k] * right[k]);
            right[i] = less / products[i][i];
        }
        for i in (0..NUMBERS).rev() {
            let less = (i + 1..NUMBERS).fold(right[i], |sum, k| sum - products[k][i] * right[k]);
            right[i] = less / products[i][i];
        }
        Some(right)
    }
}
