//! The colour of a cluster, the same in every output.
//!
//! Hues of consecutive clusters are a golden section of the circle apart, so that any few consecutive ones differ.
//! Saturation and value go round in cycles of 3 and 4, which tells clusters apart whose hues are near.

/// Part of the circle between the hues of two consecutive clusters.
const STEP: f64 = 0.618_033_988_75;

const SATURATIONS: [f64; 3] = [0.75, 0.5, 0.9];

const VALUES: [f64; 4] = [0.95, 0.75, 0.85, 0.65];

/// Red, green and blue of a cluster, sRGB.
pub fn of_cluster(cluster: u32) -> [u8; 3] {
    let hue = 6.0 * (STEP * f64::from(cluster)).fract();
    let saturation = SATURATIONS[(cluster % 3) as usize];
    let value = VALUES[(cluster % 4) as usize];
    // each channel is a trapezium over the circle of hues: high around its own hue, low around the opposite one
    [5.0, 3.0, 1.0].map(|shift: f64| {
        let place = (shift + hue) % 6.0;
        let lack = place.min(4.0 - place).clamp(0.0, 1.0);
        (255.0 * value * (1.0 - saturation * lack) + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_the_formula() {
        assert_eq!(of_cluster(0), [242, 61, 61]);
        // a hue of 0.618 is a blue, of 0.236 a green
        let [red, green, blue] = of_cluster(1);
        assert!(blue > green && green > red);
        let [red, green, blue] = of_cluster(2);
        assert!(green > red && red > blue);
    }

    #[test]
    fn clusters_in_a_row_differ() {
        let colours: Vec<[u8; 3]> = (0..1000).map(of_cluster).collect();
        for (first, one) in colours.iter().enumerate() {
            for other in &colours[first + 1..colours.len().min(first + 12)] {
                let distance: i32 = (0..3).map(|at| (i32::from(one[at]) - i32::from(other[at])).abs()).sum();
                assert!(distance > 20, "{first}: {one:?} {other:?}");
            }
        }
        assert_eq!(of_cluster(u32::MAX).len(), 3);
    }
}
