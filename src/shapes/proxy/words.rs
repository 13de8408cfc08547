//! Proxies as devices see them.

use super::{Kind, Proxy};
use crate::device::ShapeWords;

/// The types that `shaders/shapes/shape_propose.wgsl` knows.
pub const ON_DEVICES: [Kind; 3] = [Kind::Plane, Kind::Sphere, Kind::Cylinder];

impl Proxy {
    /// Its words, of a type that is [`ON_DEVICES`].
    pub fn words(&self) -> ShapeWords {
        let [low, high] = [self.c as u32, (self.c >> 32) as u32];
        let [[s, t, u], [p, q, r]] = [self.s, self.b].map(|axes| axes.map(i32::cast_unsigned));
        let [xx, xy, xz, yy, yz, zz] = self.a.map(i32::cast_unsigned);
        [low, high, s, t, u, p, q, r, xx, xy, xz, yy, yz, zz, self.e, u32::from(self.kind != Kind::Plane)]
    }
}

#[cfg(feature = "gpu")]
#[cfg(test)]
mod tests {
    //! The kernel against `cost`. Needs a Vulkan driver.

    use glam::DVec3;

    use super::*;
    use crate::dev::random;
    use crate::device::FREE;
    use crate::device::gpu::{self, Overrides};
    use crate::energy::Energy;
    use crate::shapes::moments::SHIFT;
    use crate::shapes::shape::Shape;
    use crate::surface::samples::Samples;
    use crate::surface::{DualGraph, Moves, Rows};

    /// Shapes, half as many as clusters: every second one is the one before but for a bit.
    const SHAPES: usize = 64;

    /// Faces for each cluster.
    const FACES: usize = 150;

    /// Numbers at random, the same in every run: below 1 of any size down to 2⁻³⁰, and either sign.
    fn numbers() -> impl FnMut() -> f64 {
        let mut states = random(1);
        move || {
            let state = states();
            let number = (state >> 33) as f64 / f64::from(1u32 << 31);
            libm::ldexp(if state >> 20 & 1 == 0 { number } else { -number }, -((state >> 21 & 31) as i32).min(30))
        }
    }

    #[test]
    fn proposals_are_those_of_the_costs_at_all_extremes_and_change_with_a_bit() {
        let mut number = numbers();
        let most = f64::from((1 << 27) - 1);
        let unit = f64::from(1u32 << SHIFT);
        let mut proxies: Vec<Proxy> = Vec::new();
        while proxies.len() < 2 * SHAPES {
            let at = |number: &mut dyn FnMut() -> f64| DVec3::from([0; 3].map(|_| number() * most / unit));
            let (point, mean) = (at(&mut number), at(&mut number));
            let axis = DVec3::from([0; 3].map(|_| number() + 1e-3)).normalize();
            let radius = (number() * 128.0 * most / unit).abs() + 1e-2;
            let shape = match proxies.len() / 2 % 3 {
                0 => Shape::Plane { point, normal: axis },
                1 => Shape::Sphere { centre: point, radius },
                _ => Shape::Cylinder { point, axis, radius },
            };
            let Some(proxy) = Proxy::new(&shape, mean) else { continue };
            let mut other = proxy;
            match proxies.len() / 6 % 4 {
                0 => other.s[0] ^= 1,
                1 => other.b[1] ^= 1,
                2 => other.a[3] ^= i32::from(proxy.kind != Kind::Plane),
                _ => other.c ^= 1 << 30,
            }
            proxies.extend([proxy, other]);
        }
        // a face of each cluster, and then faces beside these
        let clusters = proxies.len();
        let mut faces = vec![(vec![[0; 3]], [0; 3]); clusters];
        let mut graph: DualGraph<Energy> = DualGraph {
            moves: Moves::Free,
            points: Vec::new(),
            weights: Vec::new(),
            neighbours: Rows::empty(clusters),
            components: Vec::new(),
        };
        let mut labels: Vec<u32> = (0..clusters as u32).collect();
        for at in 0..clusters * FACES {
            let own = at % clusters;
            let count = if at % 3 == 0 { 1 + at / 3 % 64 } else { 3 };
            let origin = if at % 2 == 0 { proxies[own].s.map(f64::from) } else { [0.0; 3] };
            let sample = |_| origin.map(|x| (x + number() * most).floor().clamp(-most, most) as i32);
            faces.push(((0..count).map(sample).collect(), [0; 3]));
            let beside = [own ^ 1, at / 7 % clusters, own, at / 11 % clusters];
            graph.neighbours.push(beside.map(|cluster| cluster as u32));
            labels.push(own as u32);
        }
        graph.weights = vec![1; labels.len()];
        graph.points = vec![[0; 3]; labels.len()];
        let samples = Samples::new(&faces);
        let listed: Vec<u32> = (clusters as u32..labels.len() as u32).rev().collect();
        let expected: Vec<u32> = listed
            .iter()
            .map(|&face| {
                let cost = |cluster: u32| (proxies[cluster as usize].cost(samples.of(face)), cluster);
                let own = labels[face as usize];
                let others = graph.neighbours_of(face).iter().map(|&near| labels[near as usize]);
                let best = others.filter(|&other| other != own).map(cost).min();
                best.filter(|best| best.0 < cost(own).0).map_or(FREE, |best| best.1)
            })
            .collect();
        let moves = expected.iter().filter(|&&to| to != FREE).count();
        assert!(moves > listed.len() / 8 && moves < listed.len() * 7 / 8, "{moves} of {}", listed.len());
        let (_, mut device) = gpu::open(None, Overrides::default(), &mut Vec::new()).expect("a Vulkan driver");
        let mut steps = device.open_shapes(&graph, &samples).expect("it fits").expect("a gpu");
        let mut propose = |words: &[ShapeWords]| steps.propose(&labels, words, &listed).expect("proposals");
        let words: Vec<ShapeWords> = proxies.iter().map(Proxy::words).collect();
        let difference = |found: Vec<u32>| found.iter().zip(&expected).position(|(found, expected)| found != expected);
        assert_eq!(difference(propose(&words)), None);
        for word in [2, 4, 5, 7, 8, 13, 14] {
            let mut changed = words.clone();
            changed.iter_mut().for_each(|words| words[word] ^= 1);
            assert!(difference(propose(&changed)).is_some(), "word {word}");
        }
    }
}
