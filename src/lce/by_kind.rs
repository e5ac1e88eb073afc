//! One of three things: for fully connected encoders and decoders, for convolutional ones, or for those that read or
//! predict every frame by the same network.

use crate::nn::columns::Cut;

/// What belongs to fully connected networks (`D`), to convolutional ones (`C`), or to networks of single frames (`S`).
///
/// An encoder's buffers hold the encoder's layers themselves, so that no buffer meets a network of the other kind.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a model and a training step hold one each")]
pub enum ByKind<D, C, S> {
    /// For fully connected networks.
    Dense(D),
    /// For convolutional networks.
    Convolutional(C),
    /// For networks that read or predict single frames.
    SharedFrames(S),
}

impl<D: Cut, C: Cut, S: Cut> Cut for ByKind<D, C, S> {
    fn cut(self, samples: usize) -> (Self, Self) {
        match self {
            Self::Dense(buffers) => {
                let (left, right) = buffers.cut(samples);
                (Self::Dense(left), Self::Dense(right))
            }
            Self::Convolutional(buffers) => {
                let (left, right) = buffers.cut(samples);
                (Self::Convolutional(left), Self::Convolutional(right))
            }
            Self::SharedFrames(buffers) => {
                let (left, right) = buffers.cut(samples);
                (Self::SharedFrames(left), Self::SharedFrames(right))
            }
        }
    }
}

/// The same expression for every kind.
macro_rules! every_kind {
    ($of:expr, $it:pat => $body:expr) => {
        match $of {
            $crate::lce::by_kind::ByKind::Dense($it) => $body,
            $crate::lce::by_kind::ByKind::Convolutional($it) => $body,
            $crate::lce::by_kind::ByKind::SharedFrames($it) => $body,
        }
    };
}
pub(super) use every_kind;
