//! Vectors of numbers as little-endian bytes, for `#[serde(with = "crate::little_endian")]`. serde
//! itself writes number by number, and a 16-bit number takes up to three bytes.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserializer, Error, Visitor};
use serde::ser::Serializer;

/// A number of a fixed size.
pub(crate) trait Number: Copy {
    const BYTES: usize;
    fn write(self, to: &mut Vec<u8>);
    /// `None` if the bytes are no valid number.
    fn read(bytes: &[u8]) -> Option<Self>;
}

macro_rules! number {
    ($type:ty, $accept:expr) => {
        impl Number for $type {
            const BYTES: usize = size_of::<$type>();

            fn write(self, to: &mut Vec<u8>) {
                to.extend_from_slice(&self.to_le_bytes());
            }

            fn read(bytes: &[u8]) -> Option<Self> {
                let accept: fn(&$type) -> bool = $accept;
                Some(<$type>::from_le_bytes(bytes.try_into().ok()?)).filter(accept)
            }
        }
    };
}

number!(u8, |_| true);
number!(u16, |_| true);
number!(f32, |v| v.is_finite());

pub(crate) fn serialize<T: Number, S: Serializer>(
    values: &[T],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut bytes = Vec::with_capacity(T::BYTES * values.len());
    values.iter().for_each(|v| v.write(&mut bytes));
    serializer.serialize_bytes(&bytes)
}

pub(crate) fn deserialize<'de, T: Number, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    struct Numbers<T>(PhantomData<T>);

    impl<T: Number> Visitor<'_> for Numbers<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            write!(f, "finite numbers of {} bytes", T::BYTES)
        }

        fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<T>, E> {
            let numbers = bytes.chunks(T::BYTES).map(T::read).collect::<Option<_>>();
            numbers.ok_or_else(|| E::custom("a value is not a number"))
        }
    }

    deserializer.deserialize_bytes(Numbers(PhantomData))
}

#[cfg(test)]
mod tests {
    use serde::{Deserialize, Serialize};

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Both {
        #[serde(with = "super")]
        half: Vec<u16>,
        #[serde(with = "super")]
        single: Vec<f32>,
    }

    #[test]
    fn numbers_round_trip_in_their_own_size() {
        let both = Both { half: vec![0, 0x3c00, 0xffff], single: vec![-0.0, 1.5, f32::MAX] };
        let bytes = postcard::to_stdvec(&both).unwrap();
        assert_eq!(bytes.len(), 1 + 6 + 1 + 12);
        let again: Both = postcard::from_bytes(&bytes).unwrap();
        assert_eq!(again, both);
        assert_eq!(again.single[0].to_bits(), (-0.0_f32).to_bits());
    }

    #[test]
    fn invalid_numbers_are_refused() {
        let nan = Both { half: Vec::new(), single: vec![1.0, f32::NAN] };
        let bytes = postcard::to_stdvec(&nan).unwrap();
        assert!(postcard::from_bytes::<Both>(&bytes).is_err());
        // Three bytes are not two halves. A length beyond the end must not allocate.
        for bytes in [&[3, 1, 2, 3, 0][..], &[0xff, 0xff, 0xff, 0xff, 0x0f, 1]] {
            assert!(postcard::from_bytes::<Both>(bytes).is_err(), "{bytes:?}");
        }
    }
}
