//! Encoder and decoder by themselves, for a model that has dynamics of its own: one code and one decoded code for every
//! picture.

use super::{
    decoder::{DecoderColumns, DecoderPass},
    encoder::EncoderPass,
    model::LceModel,
};
use crate::{
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, cut_together, over_samples},
        heads,
    },
    num::Real,
};

/// Buffers for a batch of pictures. They are kept, so that a step allocates nothing.
#[derive(Debug, Clone)]
pub struct AutoEncoder<T = f32> {
    encoder: EncoderPass<T>,
    decoder: DecoderPass<T>,
    z: Block<T>,
    d_z: Block<T>,
    nll: Vec<T>,
    gradient: Vec<T>,
}

cut_together! {
    /// Some samples of the decoder's part.
    struct Decoded<'a, T> {
        decoder: DecoderColumns<'a, T>,
        z: BlockMut<'a, T>,
        d_z: BlockMut<'a, T>,
        nll: &'a mut [T],
    }
}

impl<T: Real> AutoEncoder<T> {
    /// Buffers for up to `pictures` pictures.
    pub fn new(model: &LceModel<T>, pictures: usize) -> Self {
        let (nets, n) = (&model.nets, model.sizes.latent);
        Self {
            encoder: EncoderPass::new(&nets.encoder, pictures, 1),
            decoder: DecoderPass::new(&nets.decoder, pictures, 1),
            z: Block::new(n, pictures),
            d_z: Block::new(n, pictures),
            nll: vec![T::ZERO; pictures],
            gradient: vec![T::ZERO; nets.layout.len],
        }
    }

    /// Encodes the pictures `which`; [`AutoEncoder::codes`] has the result.
    pub fn encode(&mut self, threads: usize, model: &LceModel<T>, (images, which): (&BinaryImages, &[u32])) {
        self.encoder.pack(&model.arena, images);
        let columns = self.encoder.view(which.len());
        over_samples(threads, 0, which.len(), columns, &|first, count, mut columns| {
            columns.forward(&model.arena, (images, &which[first..first + count]));
        });
    }

    /// The codes of the first `pictures` pictures (means, then log standard deviations, one column each), and the gradient
    /// with respect to them, which the caller sets before [`AutoEncoder::backward`].
    pub fn codes(&mut self, pictures: usize, mut each: impl FnMut(&[T], &mut [T])) {
        let mut columns = self.encoder.view(pictures);
        let (codes, d_codes) = columns.codes();
        each(codes, d_codes);
    }

    /// The columns to decode, one for each of the first `pictures` pictures, and the gradient with respect to them, which
    /// [`AutoEncoder::decode`] sets.
    pub fn latents(&mut self, pictures: usize) -> (&mut [T], &[T]) {
        (self.z.view(pictures).data, self.d_z.view(pictures).data)
    }

    /// Decodes the latents. Gives -ln D(x|z) of every picture, and sets the gradient of `weight` times their sum.
    pub fn decode(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        (images, which): (&BinaryImages, &[u32]),
        weight: T,
    ) -> &[T] {
        let (count, entries) = (which.len(), model.sizes.predicted_entries());
        self.decoder.pack(&model.arena);
        let columns = Decoded {
            decoder: self.decoder.view(count),
            z: self.z.view(count),
            d_z: self.d_z.view(count),
            nll: &mut self.nll[..count],
        };
        over_samples(threads, 0, count, columns, &|first, _, mut columns: Decoded<'_, T>| {
            columns.decoder.forward(&model.arena, columns.z.data);
            let (logits, deltas) = columns.decoder.logits();
            let pictures = logits.chunks_exact(entries).zip(deltas.chunks_exact_mut(entries));
            for (i, ((logits, delta), nll)) in pictures.zip(columns.nll).enumerate() {
                *nll = heads::image(logits, images, which[first + i], weight, delta);
            }
            columns.decoder.backward(&model.arena, columns.d_z.data);
        });
        &self.nll[..count]
    }

    /// The gradient of all parameters, after the gradient with respect to the codes is set. It is 0 for F and B.
    pub fn backward(&mut self, threads: usize, model: &LceModel<T>, (images, which): (&BinaryImages, &[u32])) -> &[T] {
        let (arena, count) = (&model.arena, which.len());
        let columns = self.encoder.view(count);
        over_samples(threads, 0, count, columns, &|_, _, mut columns| columns.backward(arena));
        self.encoder.gradient(threads, arena, &mut self.gradient, (images, which), count);
        self.decoder.gradient(threads, &mut self.gradient, self.z.view(count).data, count);
        &self.gradient
    }
}
