//! Declares the terms of a loss.

/// Declares a struct with one number for every term of a loss. To add a term, add its field here.
macro_rules! loss_terms {
    ($(#[$meta:meta])* pub struct $name:ident { $( $(#[$doc:meta])* $term:ident ),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub struct $name<V = f64> { $( $(#[$doc])* pub $term: V ),* }

        impl<T: $crate::num::Real> $name<T> {
            /// The sum of every term over samples, in order; `each` changes a number before it is added.
            fn sum(samples: &[Self], each: impl Fn(f64) -> f64) -> $name {
                let mut sums: $name = $name::default();
                for sample in samples {
                    $( sums.$term += each(sample.$term.f64()); )*
                }
                sums
            }
        }

        impl<V: Copy> $name<V> {
            /// Every term, changed.
            pub fn map<W>(&self, change: impl Fn(V) -> W) -> $name<W> {
                $name { $( $term: change(self.$term) ),* }
            }
        }

        impl $name {
            /// How many terms there are.
            pub const COUNT: usize = [$( stringify!($term) ),*].len();

            /// Every term with its name, in order.
            pub fn named(&self) -> [(&'static str, f64); Self::COUNT] {
                [$( (stringify!($term), self.$term) ),*]
            }
        }
    };
}
pub(super) use loss_terms;
