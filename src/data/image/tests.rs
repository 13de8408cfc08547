use ::png::{BitDepth, ColorType, Encoder};

use super::*;

fn of(width: usize, height: usize, channels: usize, samples: Vec<u8>) -> Image {
    Image { width, height, channels, samples: Samples::U8(samples) }
}

fn png(width: u32, height: u32, (colour, depth): (ColorType, BitDepth), samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().expect("a PNG file");
    writer.write_image_data(samples).expect("its samples");
    writer.finish().expect("its end");
    bytes
}

/// 8 × 8 pixels of the same grey, three channels.
const JPEG: &str = concat!(
    "ffd8ffe000104a46494600010100000100010000ffdb0043000d090a0b0a080d0b0a0b0e0e0d0f13201513121213271c",
    "1e17202e2931302e292d2c333a4a3e333646372c2d405741464c4e525352323e5a615a50604a51524fffdb0043010e0e",
    "0e131113261515264f352d354f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f4f",
    "4f4f4f4f4f4f4f4f4f4f4f4f4f4fffc00011080008000803012200021101031101ffc400150001010000000000000000",
    "0000000000000005ffc40014100100000000000000000000000000000000ffc400140101000000000000000000000000",
    "00000000ffc40014110100000000000000000000000000000000ffda000c03010002110311003f0080003fffd9",
);

#[test]
fn colours_are_those_of_scikit_image() {
    // rgb2lab of scikit-image 0.26.0
    for (rgb, expected) in [
        ([255, 0, 0], [53.2405879437, 80.0923082257, 67.2027510444]),
        ([0, 255, 0], [87.7350994883, -86.1830297444, 83.1797031754]),
        ([0, 0, 255], [32.295672565, 79.1855909118, -107.857300207]),
        ([255, 255, 255], [100.0, -0.00245493786205, 0.00465342115405]),
        ([0, 0, 0], [0.0, 0.0, 0.0]),
        ([12, 200, 77], [70.8157445996, -66.5435442307, 48.8731784498]),
        ([3, 2, 1], [0.586868916586, 0.122420676307, 0.470628057419]),
    ] {
        let linear = Samples::U8(Vec::new()).linear();
        let found = lab(rgb.map(|sample: u8| linear[usize::from(sample)]));
        assert!((0..3).all(|axis| (found[axis] - expected[axis]).abs() < 1e-9), "{rgb:?}: {found:?}");
        // 16 bits mean the same
        let sixteen = Samples::U16(Vec::new()).linear();
        assert_eq!(lab(rgb.map(|sample: u8| sixteen[usize::from(sample) * 257])), found);
    }
}

#[test]
fn a_pixel_has_its_colour_over_the_compactness_and_its_place_over_the_side_of_a_superpixel() {
    let image = of(4, 2, 3, (0..24).map(|sample| sample * 10).collect());
    let set = superpixels(&image, None, 2, 20.0).expect("points");
    assert_eq!((set.dimensions, &set.shape[..], &set.mask), (5, &[2, 4][..], &None));
    let linear = image.samples.linear();
    let expected = lab([150, 160, 170].map(|sample: usize| linear[sample]));
    let found: Vec<f64> = (0..5).map(|axis| set.at(5, axis)).collect();
    // pixel 5 is the second of the second row; 8 pixels over 2 clusters are squares with sides of 2
    let expected = [expected[0] / 20.0, expected[1] / 20.0, expected[2] / 20.0, 0.5, 0.5];
    assert_eq!(found, expected.map(|x| f64::from(x as f32)));

    let grey = superpixels(&of(3, 1, 1, vec![0, 7, 128]), None, 3, 10.0).expect("points");
    assert_eq!((grey.dimensions, grey.at(1, 1), grey.at(1, 2)), (3, 1.0, 0.0));
    assert!((grey.at(2, 0) - 5.3585013452).abs() < 1e-6 && (grey.at(1, 0) - 0.19192144722).abs() < 1e-7);
}

#[test]
fn pixels_without_opacity_and_masked_ones_take_no_part_and_do_not_widen_superpixels() {
    let image = of(4, 1, 2, vec![9, 255, 9, 0, 9, 1, 9, 255]);
    let set = superpixels(&image, Some(&[true, true, true, false]), 2, 10.0).expect("points");
    assert_eq!((set.mask.as_deref(), set.at(2, 1)), (Some(&[true, false, true, false][..]), 2.0));
    let error = superpixels(&image, Some(&[false; 4]), 2, 10.0).expect_err("no pixel");
    assert!(error.message.contains("no pixel takes part"), "{error}");
}

#[test]
fn images_are_decoded_with_the_samples_that_they_were_written_with() {
    let samples: Vec<u8> = (0..48).map(|sample| sample * 5).collect();
    for (colour, channels, bytes) in [
        ((ColorType::Grayscale, BitDepth::Eight), 1, 1),
        ((ColorType::GrayscaleAlpha, BitDepth::Eight), 2, 1),
        ((ColorType::Rgb, BitDepth::Eight), 3, 1),
        ((ColorType::Rgba, BitDepth::Eight), 4, 1),
        ((ColorType::Grayscale, BitDepth::Sixteen), 1, 2),
        ((ColorType::Rgb, BitDepth::Sixteen), 3, 2),
        ((ColorType::Rgba, BitDepth::Sixteen), 4, 2),
    ] {
        let length = 6 * channels * bytes;
        let image = decode(&png(3, 2, colour, &samples[..length]), 6, 1 << 20).expect("an image");
        assert_eq!((image.width, image.height, image.channels), (3, 2, channels), "{colour:?}");
        match image.samples {
            Samples::U8(found) => assert_eq!((bytes, &found[..]), (1, &samples[..length])),
            Samples::U16(found) => {
                let found: Vec<u8> = found.iter().flat_map(|sample| sample.to_be_bytes()).collect();
                assert_eq!((bytes, &found[..]), (2, &samples[..length]));
            }
        }
    }
    let jpeg: Vec<u8> =
        (0..JPEG.len()).step_by(2).map(|at| u8::from_str_radix(&JPEG[at..at + 2], 16).expect("a byte")).collect();
    let cut = decode(&jpeg[..jpeg.len() - 4], 64, 1 << 20).expect_err("a cut file");
    assert!(cut.message.contains("cannot be read"), "{cut}");
    let image = decode(&jpeg, 64, 1 << 20).expect("an image");
    assert_eq!((image.width, image.height, image.channels), (8, 8, 3));
    assert!(matches!(image.samples, Samples::U8(samples) if samples.iter().all(|&sample| sample.abs_diff(77) < 3)));
}

#[test]
fn what_is_no_such_image_is_one_clear_line() {
    let file = png(3, 2, (ColorType::Grayscale, BitDepth::Eight), &[7; 6]);
    let mut claim = file.clone();
    claim[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    for (bytes, pixels, limit, words) in [
        (&b"GIF89a"[..], 6, 1 << 20, "cannot be read"),
        (&file[..60], 6, 1 << 20, "cannot be read"),
        (&file[..20], 6, 1 << 20, "cannot be read"),
        (&file, 5, 1 << 20, "more pixels than allowed, 5: 3 × 2"),
        (&file, 6, 5, "more bytes than allowed, 5"),
        (&claim, u64::MAX, 1 << 30, ": "),
    ] {
        let error = decode(bytes, pixels, limit).expect_err(words);
        assert!(error.message.contains(words) && !error.message.contains('\n'), "{error}");
    }
    let image = of(2, 1, 3, vec![0; 6]);
    for (image, mask, clusters, compactness, words) in [
        (&of(2, 2, 3, vec![0; 6]), None, 1, 10.0, "so many samples: 6"),
        (&of(1, 1, 5, vec![0; 5]), None, 1, 10.0, "1 to 4"),
        (&of(usize::MAX, 2, 1, vec![0; 5]), None, 1, 10.0, "so many samples: 5"),
        (&image, Some(&[true][..]), 1, 10.0, "2 pixels: 1"),
        (&image, None, 0, 10.0, "at least 1: 0"),
        (&image, None, 1, 0.0, "from 0.001 to 1000000: 0"),
        (&image, None, 1, f64::NAN, "NaN"),
    ] {
        let error = superpixels(image, mask, clusters, compactness).expect_err(words);
        assert!(error.message.contains(words), "{error}");
    }
}

#[test]
fn a_mean_of_one_colour_is_that_colour() {
    for rgb in (0..125).map(|nth| [nth / 25, nth / 5 % 5, nth % 5].map(|step| (step * 63 + 1) as u8)) {
        let image = Image { width: 1, height: 1, channels: 3, samples: Samples::U8(rgb.to_vec()) };
        let set = superpixels(&image, None, 1, 7.0).expect("a pixel");
        let mean: Vec<f64> = (0..5).map(|axis| set.at(0, axis)).collect();
        assert_eq!(colour(&mean, 7.0), rgb);
        let grey = Image { channels: 1, samples: Samples::U8(vec![rgb[0]]), ..image };
        let set = superpixels(&grey, None, 1, 7.0).expect("a pixel");
        assert_eq!(colour(&[set.at(0, 0), 0.0, 0.0], 7.0), [rgb[0]; 3]);
    }
}
