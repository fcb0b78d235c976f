//! Lossless JPEG (ITU-T T.81, annex H): Huffman-coded differences from a prediction.

struct Header {
    precision: u32,
    height: usize,
    width: usize,
    /// Name of each component.
    components: Vec<u8>,
}

/// Huffman code, indexed by the next 16 bits: length of the word, and number of extra bits. Length
/// 0 marks unused words.
type Code = Vec<(u8, u8)>;

/// Decodes exactly `count` samples, row by row with interleaved components.
pub fn decode(bytes: &[u8], count: usize) -> Result<Vec<u16>, String> {
    let mut codes: [Option<Code>; 4] = [const { None }; 4];
    let mut header = None;
    let mut at = 0;
    if segment_marker(bytes, &mut at)? != 0xD8 {
        return Err("lossless JPEG without its start".into());
    }
    loop {
        let marker = segment_marker(bytes, &mut at)?;
        let body = segment(bytes, &mut at)?;
        match marker {
            0xC3 => header = Some(read_header(body, count)?),
            0xC4 => read_codes(body, &mut codes)?,
            0xDA => {
                let header = header.ok_or("lossless JPEG without a frame header")?;
                return scan(&header, &codes, body, &bytes[at..]);
            }
            0xC0..=0xCF => {
                return Err(format!(
                    "JPEG of process {} where the lossless one is read",
                    marker & 15
                ));
            }
            0xDD if body != [0, 0] => {
                return Err("lossless JPEG with restart intervals is not read".into());
            }
            0xD9 => return Err("lossless JPEG without a scan".into()),
            _ => (),
        }
    }
}

fn truncated() -> String {
    "truncated lossless JPEG".into()
}

fn segment_marker(bytes: &[u8], at: &mut usize) -> Result<u8, String> {
    let start = *at;
    let fill = bytes[start..].iter().take_while(|b| **b == 0xFF).count();
    let marker = *bytes.get(start + fill).ok_or_else(truncated)?;
    *at = start + fill + 1;
    if fill == 0 { Err("damaged lossless JPEG: no marker".into()) } else { Ok(marker) }
}

fn segment<'a>(bytes: &'a [u8], at: &mut usize) -> Result<&'a [u8], String> {
    let length = bytes.get(*at..*at + 2).ok_or_else(truncated)?;
    let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
    let body = bytes.get(*at + 2..*at + length.max(2)).ok_or_else(truncated)?;
    *at += length.max(2);
    Ok(body)
}

fn read_header(body: &[u8], count: usize) -> Result<Header, String> {
    let &[precision, h1, h0, w1, w0, n, ref rest @ ..] = body else { return Err(truncated()) };
    let height = usize::from(u16::from_be_bytes([h1, h0]));
    let width = usize::from(u16::from_be_bytes([w1, w0]));
    if !(2..=16).contains(&precision) {
        return Err(format!("lossless JPEG of {precision} bits; 2 to 16 are expected"));
    }
    let components = rest.as_chunks::<3>().0;
    if !(1..=4).contains(&n) || components.len() < usize::from(n) {
        return Err(format!("lossless JPEG of {n} components; 1 to 4 are expected"));
    }
    let components = &components[..usize::from(n)];
    if components.iter().any(|c| c[1] != 0x11) {
        return Err("lossless JPEG with subsampled components is not read".into());
    }
    if height * width * components.len() != count {
        return Err(format!(
            "lossless JPEG of {width} x {height} x {n} samples where {count} samples are expected"
        ));
    }
    let components = components.iter().map(|c| c[0]).collect();
    Ok(Header { precision: precision.into(), height, width, components })
}

fn read_codes(mut body: &[u8], codes: &mut [Option<Code>; 4]) -> Result<(), String> {
    while let Some((&[class, ref lengths @ ..], rest)) = body.split_first_chunk::<17>() {
        let total = lengths.iter().map(|n| usize::from(*n)).sum();
        let values = rest.get(..total).ok_or_else(truncated)?;
        body = &rest[total..];
        let damaged = || "damaged Huffman code in lossless JPEG".to_string();
        let slot = codes.get_mut(usize::from(class)).ok_or_else(damaged)?;
        let mut code: Code = Vec::with_capacity(1 << 16);
        let mut next = values.iter();
        for (length, &words) in (1u8..).zip(lengths) {
            for &bits in next.by_ref().take(words.into()) {
                let size = code.len() + (1 << (16 - length));
                if size > 1 << 16 || bits > 16 {
                    return Err(damaged());
                }
                code.resize(size, (length, bits));
            }
        }
        code.resize(1 << 16, (0, 0));
        *slot = Some(code);
    }
    Ok(())
}

fn scan(
    header: &Header,
    codes: &[Option<Code>; 4],
    body: &[u8],
    data: &[u8],
) -> Result<Vec<u16>, String> {
    let n = header.components.len();
    let (Some(components), Some(&[predictor, _, shift])) =
        (body.get(1..1 + 2 * n), body.get(1 + 2 * n..4 + 2 * n).and_then(|r| r.first_chunk()))
    else {
        return Err(truncated());
    };
    let in_order = components.chunks(2).zip(&header.components).all(|(c, id)| c[0] == *id);
    let shift = u32::from(shift & 15);
    if usize::from(body[0]) != n || !in_order || !(1..=7).contains(&predictor) {
        return Err(format!("lossless JPEG with predictor {predictor} or a scan that is not read"));
    }
    if shift >= header.precision {
        return Err(format!("lossless JPEG with a point transform of {shift} bits"));
    }
    let codes: Option<Vec<&Code>> = components
        .chunks(2)
        .map(|c| codes.get(usize::from(c[1] >> 4)).and_then(|code| code.as_ref()))
        .collect();
    let codes = codes.ok_or("lossless JPEG without its Huffman code")?;
    let mut bits = Bits { data, at: 0, hold: 0, count: 0, padding: 0 };
    let row = header.width * n;
    let mut samples: Vec<u16> = Vec::with_capacity(header.height * row);
    for i in 0..header.height * row {
        let (y, x, c) = (i / row, i % row / n, i % n);
        let known = |back: usize| i32::from(samples[i - back]);
        let predicted = match (x, y) {
            (0, 0) => 1 << (header.precision - shift - 1),
            (0, _) => known(row),
            (_, 0) => known(n),
            _ => predict(predictor, known(n), known(row), known(row + n)),
        };
        // The standard computes modulo 2^16.
        samples.push((predicted + bits.difference(codes[c])?) as u16);
    }
    if shift > 0 {
        samples.iter_mut().for_each(|v| *v <<= shift);
    }
    Ok(samples)
}

fn predict(predictor: u8, left: i32, above: i32, corner: i32) -> i32 {
    match predictor {
        1 => left,
        2 => above,
        3 => corner,
        4 => left + above - corner,
        5 => left + ((above - corner) >> 1),
        6 => above + ((left - corner) >> 1),
        _ => (left + above) >> 1,
    }
}

/// Bits of a scan, highest first.
struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    /// Bits read so far, from the highest down.
    hold: u64,
    count: u32,
    /// Number of them beyond the end of the data.
    padding: u32,
}

impl Bits<'_> {
    fn difference(&mut self, code: &Code) -> Result<i32, String> {
        self.fill();
        let (length, bits) = code[(self.hold >> 48) as usize];
        if length == 0 {
            return Err("damaged lossless JPEG: no such code word".into());
        }
        self.take(length.into());
        let bits = u32::from(bits);
        let difference = match bits {
            0 => 0,
            16 => 1 << 15,
            _ => {
                let value = self.take(bits);
                let is_negative = value >> (bits - 1) == 0;
                if is_negative { value - (1 << bits) + 1 } else { value }
            }
        };
        if self.count < self.padding { Err(truncated()) } else { Ok(difference) }
    }

    /// Buffers at least 49 bits.
    fn fill(&mut self) {
        while self.count <= 48 {
            let byte = match (self.data.get(self.at), self.data.get(self.at + 1)) {
                (Some(0xFF), Some(0)) => {
                    self.at += 2;
                    0xFF
                }
                (Some(0xFF), _) | (None, _) => {
                    self.padding += 8;
                    0
                }
                (Some(byte), _) => {
                    self.at += 1;
                    *byte
                }
            };
            self.hold |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// The next 1 to 16 bits.
    fn take(&mut self, bits: u32) -> i32 {
        let value = self.hold >> (64 - bits);
        self.hold <<= bits;
        self.count -= bits;
        value as i32
    }
}
