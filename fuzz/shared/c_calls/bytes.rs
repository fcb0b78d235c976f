//! Numbers from the fuzzer's bytes.

pub struct Bytes<'a>(pub &'a [u8]);

impl Bytes<'_> {
    pub fn u8(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// Mostly small and likely numbers, sometimes any.
    pub fn u32(&mut self) -> u32 {
        match self.u8() {
            0xFF => u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()]),
            0xFE => u32::MAX,
            0xFD => 256,
            0xFC => 512,
            small => u32::from(small % 16),
        }
    }

    pub fn usize(&mut self) -> usize {
        match self.u8() {
            0xFF => usize::MAX,
            0xFE => usize::MAX / 2 + 1,
            other => usize::from(other) * 64,
        }
    }

    pub fn f32(&mut self) -> f32 {
        match self.u8() {
            0xFF => {
                f32::from_bits(u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()]))
            }
            0xFE => f32::NAN,
            0xFD => f32::INFINITY,
            0xFC => -1.0,
            0xFB => f32::MIN_POSITIVE,
            other => f32::from(other),
        }
    }

    pub fn done(&self) -> bool {
        self.0.is_empty()
    }
}
