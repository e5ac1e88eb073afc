//! Pictures of a file, in any of the usual forms, as the task's observations.

use anyhow::{bail, ensure};

use crate::{
    arrays::{Array, Dtype},
    env::Frames,
};

/// Pictures in the form of the task's observations.
#[derive(Debug)]
pub(super) struct Pictures {
    pixels: Vec<u8>,
    frames: Frames,
    /// Whether each picture is a whole observation rather than one frame.
    is_whole: bool,
}

impl Pictures {
    /// Takes pictures of the shape `[n, height, width]`, also with colours behind, or with frames before.
    pub(super) fn new(array: Array, frames: Frames, threshold: Option<u8>) -> anyhow::Result<Self> {
        let Frames { height, width, channels, shades, count } = frames;
        let shape = array.shape.clone();
        let (own_height, colours) = match shape[..] {
            [_, own, columns] if columns == width => (own, 1),
            [_, own, columns, colours @ (1 | 3)] if columns == width => (own, colours),
            [_, own, rows, columns] if (rows, columns) == (height, width) => (own * rows, 1),
            _ => (0, 1),
        };
        let turns_grey = colours == 3 && channels == 1;
        let stored = own_height * if turns_grey { 1 } else { colours };
        let is_whole = stored == count * channels * height;
        ensure!(
            is_whole || stored == channels * height,
            "the shape is {shape:?}, but the task has pictures of {height} x {width}{}{}",
            if channels > 1 { format!(" x {channels}") } else { String::new() },
            if count > 1 { format!(", {count} frames one above the other") } else { String::new() }
        );
        let mut pixels = bytes(array)?;
        if turns_grey {
            pixels = pixels.chunks_exact(3).map(grey).collect();
        } else if colours > 1 {
            pixels = planes(&pixels, height * width, colours);
        }
        match threshold {
            Some(threshold) => pixels.iter_mut().for_each(|pixel| *pixel = if *pixel >= threshold { 255 } else { 0 }),
            None if shades => {}
            None => {
                if let Some(at) = pixels.iter().position(|pixel| !matches!(pixel, 0 | 255)) {
                    let picture = at / (stored * width);
                    bail!("picture {picture} has a pixel of {}, but pixels are 0 or 255: set `threshold`", pixels[at]);
                }
            }
        }
        Ok(Self { pixels, frames, is_whole })
    }

    fn size(&self) -> usize {
        self.frames.pixels() * if self.is_whole { self.frames.count } else { 1 }
    }

    /// How many pictures there are.
    pub(super) fn len(&self) -> usize {
        self.pixels.len() / self.size()
    }

    /// Whether an observation takes pictures that follow each other.
    pub(super) fn are_frames(&self) -> bool {
        !self.is_whole
    }

    /// A picture as it is.
    pub(super) fn picture(&self, at: usize) -> &[u8] {
        &self.pixels[at * self.size()..][..self.size()]
    }

    /// The observation that ends with a picture. `first` is the first picture of its episode; older frames than that one
    /// look like it.
    pub(super) fn observation(&self, at: usize, first: usize) -> anyhow::Result<Vec<u8>> {
        ensure!(at < self.len(), "there is no picture {at}");
        if self.is_whole {
            return Ok(self.picture(at).to_vec());
        }
        let frames = (0..self.frames.count).rev().map(|back| self.picture(at.saturating_sub(back).max(first)));
        Ok(frames.collect::<Vec<_>>().concat())
    }
}

/// Frames of `plane` pixels whose colours stand side by side, with each colour as a whole picture.
fn planes(pixels: &[u8], plane: usize, colours: usize) -> Vec<u8> {
    let of_frame = |frame| (0..colours).flat_map(move |colour| (0..plane).map(move |at| frame + at * colours + colour));
    let frames = (0..pixels.len()).step_by(plane * colours);
    frames.flat_map(of_frame).map(|at| pixels[at]).collect()
}

/// Grey as television weighs colours.
fn grey(colour: &[u8]) -> u8 {
    let [red, green, blue] = [colour[0], colour[1], colour[2]].map(u32::from);
    ((299 * red + 587 * green + 114 * blue + 500) / 1000) as u8
}

/// Bytes from 0 to 255. Fractions lie in 0..1.
fn bytes(array: Array) -> anyhow::Result<Vec<u8>> {
    if array.dtype == Dtype::U8 {
        return Ok(array.bytes);
    }
    let scale = if array.dtype.is_float() || array.dtype == Dtype::Bool { 255.0 } else { 1.0 };
    let byte = |(at, number): (usize, f64)| {
        let scaled = (number * scale).round();
        ensure!(
            (0.0..=255.0).contains(&scaled),
            "number {number} at index {at} is no pixel: {} lie in 0..{}",
            array.dtype,
            255.0 / scale
        );
        Ok(scaled as u8)
    };
    array.numbers().enumerate().map(byte).collect()
}
