//! Reads the test vectors exported by the training code.

/// Tensors of a file of test vectors (`SVBRDFT1`) by name, with their shapes.
pub(crate) fn test_vectors(
    bytes: &[u8],
) -> std::collections::HashMap<String, (Vec<usize>, Vec<f32>)> {
    assert_eq!(&bytes[..8], b"SVBRDFT1");
    let length = u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&bytes[12..12 + length]).unwrap();
    let data: Vec<f32> = bytes[12 + length..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect();
    let number = |v: &serde_json::Value| v.as_u64().unwrap() as usize;
    header["tensors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|t| {
            let shape: Vec<usize> = t["shape"].as_array().unwrap().iter().map(number).collect();
            let start = number(&t["offset"]);
            let values = data[start..start + shape.iter().product::<usize>()].to_vec();
            (t["name"].as_str().unwrap().to_owned(), (shape, values))
        })
        .collect()
}

/// Largest difference over the largest expected value.
pub(crate) fn difference(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let scale = expected.iter().fold(0.0f32, |a, v| a.max(v.abs()));
    found.iter().zip(expected).fold(0.0f32, |a, (f, e)| a.max((f - e).abs())) / scale
}
