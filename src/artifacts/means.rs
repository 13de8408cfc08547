//! The means of the clusters of an image, as an image.

use png::{BitDepth, ColorType};

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, image};
use crate::data::image::colour;
use crate::device::FREE;
use crate::error::{Error, Result};

/// The image with each cluster in its mean colour.
pub static MEANS: Artifact = Artifact {
    name: "means",
    about: "An image with each cluster in its mean colour.",
    needs: &[Need::Labels, Need::Image],
    forms: &[Form { file: "means.png", media_type: "image/png", is_stored: false, schema: None, encode: png }],
    choices: &[],
    flags: &[Flag {
        name: "--means",
        value: "OUT",
        help: "Where to write an image with each cluster in its mean colour: OUT.png",
    }],
    is_of_points: true,
    is_served: true,
};

/// 8-bit red, green, blue and alpha, which is 0 where a mask leaves a pixel out.
fn png<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let labels = given(content.labels)?.labels;
    let no_image = || Error::conflict("means.png is made of an image, and this is none");
    let compactness = content.compactness.ok_or_else(no_image)?;
    let size = image::size(content, MEANS.forms[0].file)?;
    let colours: Vec<[u8; 3]> = given(content.points)?.rows.iter().map(|row| colour(&row.mean, compactness)).collect();
    Ok(Box::new(move |out| {
        let pixel = |&label: &u32| match label {
            FREE => [0; 4],
            label => {
                let [red, green, blue] = colours[label as usize];
                [red, green, blue, u8::MAX]
            }
        };
        let samples: Vec<u8> = labels.iter().flat_map(pixel).collect();
        image::write(out, size, ColorType::Rgba, BitDepth::Eight, &samples)
    }))
}
