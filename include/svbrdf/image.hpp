// Part of svbrdf.hpp: images in memory, in every pixel format. Nothing is copied: a svbrdf_image
// points to the caller's pixels, which the session reads before it returns.
#ifndef SVBRDF_IMAGE_HPP
#define SVBRDF_IMAGE_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core.hpp"
#include "enums.hpp"

namespace svbrdf {

/// Bytes of a pixel in a format of one plane.
constexpr std::size_t pixel_bytes(PixelFormat format) noexcept {
    switch (format) {
        case PixelFormat::rgb8: return 3;
        case PixelFormat::rgba8:
        case PixelFormat::bgra8: return 4;
        case PixelFormat::rgb16: return 6;
        case PixelFormat::rgba16:
        case PixelFormat::rgba_f16: return 8;
        case PixelFormat::rgb_f32: return 12;
        case PixelFormat::rgba_f32: return 16;
        case PixelFormat::bayer16: return 2;
        case PixelFormat::yuv420:
        case PixelFormat::p010: break;
    }
    return 0;
}

namespace detail {

/// A plane of `rows` rows, the last of which may end with its last pixel.
inline svbrdf_plane plane(const void* data, std::size_t row_stride, std::size_t pixel_stride,
                          std::size_t row_bytes, std::uint32_t rows) noexcept {
    svbrdf_plane plane{};
    plane.data = data;
    plane.row_stride = row_stride != 0 ? row_stride : row_bytes;
    plane.pixel_stride = pixel_stride;
    plane.bytes = rows == 0 ? 0 : plane.row_stride * (rows - 1) + row_bytes;
    return plane;
}

inline svbrdf_image image(PixelFormat format, std::uint32_t width, std::uint32_t height,
                          Transfer transfer) {
    svbrdf_image image = make(svbrdf_image_init);
    image.format = to_c(format);
    image.width = width;
    image.height = height;
    image.transfer = to_c(transfer);
    return image;
}

inline svbrdf_image packed(PixelFormat format, const void* data, std::uint32_t width,
                           std::uint32_t height, Transfer transfer, std::size_t row_stride) {
    svbrdf_image image = detail::image(format, width, height, transfer);
    image.planes[0] = plane(data, row_stride, 0, pixel_bytes(format) * width, height);
    return image;
}

}  // namespace detail

// Pictures of one plane. `row_stride`: bytes from a row to the next, 0 for rows without a gap.

/// 8 bits a channel: red, green, blue.
inline svbrdf_image rgb8(const std::uint8_t* data, std::uint32_t width, std::uint32_t height,
                         Transfer transfer = Transfer::srgb, std::size_t row_stride = 0) {
    return detail::packed(PixelFormat::rgb8, data, width, height, transfer, row_stride);
}
/// 8 bits a channel: red, green, blue, and a fourth that is ignored.
inline svbrdf_image rgba8(const std::uint8_t* data, std::uint32_t width, std::uint32_t height,
                          Transfer transfer = Transfer::srgb, std::size_t row_stride = 0) {
    return detail::packed(PixelFormat::rgba8, data, width, height, transfer, row_stride);
}
/// 8 bits a channel: blue, green, red, and a fourth that is ignored.
inline svbrdf_image bgra8(const std::uint8_t* data, std::uint32_t width, std::uint32_t height,
                          Transfer transfer = Transfer::srgb, std::size_t row_stride = 0) {
    return detail::packed(PixelFormat::bgra8, data, width, height, transfer, row_stride);
}
/// 16 bits a channel: red, green, blue.
inline svbrdf_image rgb16(const std::uint16_t* data, std::uint32_t width, std::uint32_t height,
                          Transfer transfer = Transfer::srgb, std::size_t row_stride = 0) {
    return detail::packed(PixelFormat::rgb16, data, width, height, transfer, row_stride);
}
/// 16 bits a channel: red, green, blue, and a fourth that is ignored.
inline svbrdf_image rgba16(const std::uint16_t* data, std::uint32_t width, std::uint32_t height,
                           Transfer transfer = Transfer::srgb, std::size_t row_stride = 0) {
    return detail::packed(PixelFormat::rgba16, data, width, height, transfer, row_stride);
}
/// Linear half floats, given as their bits: red, green, blue, and a fourth that is ignored. A channel
/// is clipped from `saturation` on.
inline svbrdf_image rgba_f16(const std::uint16_t* data, std::uint32_t width, std::uint32_t height,
                             float saturation = std::numeric_limits<float>::infinity(),
                             std::size_t row_stride = 0) {
    svbrdf_image image = detail::packed(PixelFormat::rgba_f16, data, width, height,
                                        Transfer::linear, row_stride);
    image.saturation = saturation;
    return image;
}
/// Linear floats: red, green, blue. A channel is clipped from `saturation` on.
inline svbrdf_image rgb_f32(const float* data, std::uint32_t width, std::uint32_t height,
                            float saturation = std::numeric_limits<float>::infinity(),
                            std::size_t row_stride = 0) {
    svbrdf_image image = detail::packed(PixelFormat::rgb_f32, data, width, height,
                                        Transfer::linear, row_stride);
    image.saturation = saturation;
    return image;
}
/// Linear floats: red, green, blue, and a fourth that is ignored. A channel is clipped from
/// `saturation` on.
inline svbrdf_image rgba_f32(const float* data, std::uint32_t width, std::uint32_t height,
                             float saturation = std::numeric_limits<float>::infinity(),
                             std::size_t row_stride = 0) {
    svbrdf_image image = detail::packed(PixelFormat::rgba_f32, data, width, height,
                                        Transfer::linear, row_stride);
    image.saturation = saturation;
    return image;
}

/// Description of the values of a raw sensor.
struct Sensor {
    BayerPattern pattern = BayerPattern::rggb;
    /// Value of darkness at the four places of the pattern, row by row.
    std::array<float, 4> black_level{};
    /// Value of full scale; at and above it a sample is clipped.
    float white_level = 65535.0f;
    /// Gains of red, green and blue that make neutral gray neutral.
    std::array<float, 3> white_balance{1.0f, 1.0f, 1.0f};
    /// From white-balanced sensor colours to linear Rec. 709, row by row.
    std::array<float, 9> color_matrix{1, 0, 0, 0, 1, 0, 0, 0, 1};
};

/// 16-bit values of a sensor behind a Bayer mosaic: the best there is.
inline svbrdf_image bayer16(const std::uint16_t* data, std::uint32_t width, std::uint32_t height,
                            const Sensor& sensor, std::size_t row_stride = 0) {
    svbrdf_image image = detail::packed(PixelFormat::bayer16, data, width, height,
                                        Transfer::linear, row_stride);
    image.bayer_pattern = to_c(sensor.pattern);
    image.white_level = sensor.white_level;
    for (std::size_t i = 0; i < 4; i++) {
        image.black_level[i] = sensor.black_level[i];
    }
    for (std::size_t i = 0; i < 3; i++) {
        image.white_balance[i] = sensor.white_balance[i];
    }
    for (std::size_t i = 0; i < 9; i++) {
        image.color_matrix[i] = sensor.color_matrix[i];
    }
    return image;
}

// YUV 4:2:0: luma, and chroma of half the size, rounded up. A camera with a linear tone curve gives
// Transfer::linear.

/// A plane of chroma: its first value, and the bytes from a row (0: no gap) and from a value to the
/// next.
struct ChromaPlane {
    const void* data = nullptr;
    std::size_t row_stride = 0;
    std::size_t pixel_stride = 1;
};

/// Three planes with strides of their own, as Android's YUV_420_888.
inline svbrdf_image yuv420(const std::uint8_t* luma, std::size_t luma_stride, ChromaPlane u,
                           ChromaPlane v, std::uint32_t width, std::uint32_t height,
                           YuvMatrix matrix = YuvMatrix::bt601_full,
                           Transfer transfer = Transfer::srgb) {
    svbrdf_image image = detail::image(PixelFormat::yuv420, width, height, transfer);
    image.yuv_matrix = to_c(matrix);
    const std::uint32_t columns = width / 2 + width % 2, rows = height / 2 + height % 2;
    image.planes[0] = detail::plane(luma, luma_stride, 0, width, height);
    int i = 1;
    for (const ChromaPlane& chroma : {u, v}) {
        const std::size_t whole = chroma.pixel_stride * columns;
        const std::size_t row = columns == 0 ? 0 : whole - chroma.pixel_stride + 1;
        image.planes[i++] =
            detail::plane(chroma.data, chroma.row_stride != 0 ? chroma.row_stride : whole,
                          chroma.pixel_stride, row, rows);
    }
    return image;
}
/// Two planes: luma, and U and V by turns.
inline svbrdf_image nv12(const std::uint8_t* luma, std::size_t luma_stride, const std::uint8_t* uv,
                         std::size_t uv_stride, std::uint32_t width, std::uint32_t height,
                         YuvMatrix matrix = YuvMatrix::bt601_full,
                         Transfer transfer = Transfer::srgb) {
    return yuv420(luma, luma_stride, {uv, uv_stride, 2}, {uv == nullptr ? uv : uv + 1, uv_stride, 2},
                  width, height, matrix, transfer);
}
/// Two planes: luma, and V and U by turns.
inline svbrdf_image nv21(const std::uint8_t* luma, std::size_t luma_stride, const std::uint8_t* vu,
                         std::size_t vu_stride, std::uint32_t width, std::uint32_t height,
                         YuvMatrix matrix = YuvMatrix::bt601_full,
                         Transfer transfer = Transfer::srgb) {
    return yuv420(luma, luma_stride, {vu == nullptr ? vu : vu + 1, vu_stride, 2}, {vu, vu_stride, 2},
                  width, height, matrix, transfer);
}
/// Three planes: luma, U and V.
inline svbrdf_image i420(const std::uint8_t* luma, std::size_t luma_stride, const std::uint8_t* u,
                         const std::uint8_t* v, std::size_t chroma_stride, std::uint32_t width,
                         std::uint32_t height, YuvMatrix matrix = YuvMatrix::bt601_full,
                         Transfer transfer = Transfer::srgb) {
    return yuv420(luma, luma_stride, {u, chroma_stride, 1}, {v, chroma_stride, 1}, width, height,
                  matrix, transfer);
}
/// 10 bits in the upper part of 16-bit words: luma, and U and V by turns. Strides in bytes.
inline svbrdf_image p010(const std::uint16_t* luma, std::size_t luma_stride,
                         const std::uint16_t* uv, std::size_t uv_stride, std::uint32_t width,
                         std::uint32_t height, YuvMatrix matrix = YuvMatrix::bt2020_limited,
                         Transfer transfer = Transfer::srgb) {
    svbrdf_image image = detail::image(PixelFormat::p010, width, height, transfer);
    image.yuv_matrix = to_c(matrix);
    const std::uint32_t columns = width / 2 + width % 2, rows = height / 2 + height % 2;
    const std::size_t row = columns == 0 ? 0 : std::size_t{4} * (columns - 1) + 2;
    const std::size_t stride = uv_stride != 0 ? uv_stride : std::size_t{4} * columns;
    image.planes[0] = detail::plane(luma, luma_stride, 0, std::size_t{2} * width, height);
    image.planes[1] = detail::plane(uv, stride, 4, row, rows);
    image.planes[2] = detail::plane(uv == nullptr ? uv : uv + 1, stride, 4, row, rows);
    return image;
}

}  // namespace svbrdf

#endif
