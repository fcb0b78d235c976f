// Part of svbrdf.hpp: maps, their outputs, and boards to print.
#ifndef SVBRDF_MAPS_HPP
#define SVBRDF_MAPS_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core.hpp"
#include "enums.hpp"

namespace svbrdf {

/// A map in memory of its Maps.
template <typename T>
struct MapView {
    Span<const T> values;
    std::uint32_t width, height, channels;
    /// First channel of a texel.
    const T* at(std::uint32_t x, std::uint32_t y) const noexcept {
        return values.data() + (std::size_t{y} * width + x) * channels;
    }
};

/// Exported files in memory.
class Package {
public:
    explicit Package(svbrdf_package* package) noexcept : owner_(package) {}
    /// Number of files.
    std::uint32_t count() const {
        std::uint32_t count = 0;
        check(svbrdf_package_count(owner_.get(), &count));
        return count;
    }
    /// Name of a file: relative, "/" between folders.
    std::string name(std::uint32_t index) const {
        const char* name = nullptr;
        check(svbrdf_package_file(owner_.get(), index, &name, nullptr, nullptr));
        return name;
    }
    /// Valid as long as this package.
    Span<const std::uint8_t> bytes(std::uint32_t index) const {
        const void* data = nullptr;
        std::size_t size = 0;
        check(svbrdf_package_file(owner_.get(), index, nullptr, &data, &size));
        return {static_cast<const std::uint8_t*>(data), size};
    }
    /// The file of that name; empty where there is none.
    Span<const std::uint8_t> bytes(const std::string& wanted) const {
        for (std::uint32_t i = 0, n = count(); i < n; ++i) {
            if (name(i) == wanted) {
                return bytes(i);
            }
        }
        return {};
    }

private:
    detail::Owner<svbrdf_package, svbrdf_package_destroy> owner_;
};

/// Maps at one moment.
class Maps {
public:
    explicit Maps(svbrdf_maps* maps) noexcept : owner_(maps) {}
    /// Maps of values in memory, which are needed during the call only.
    static Maps from_memory(const svbrdf_maps_input& input) {
        svbrdf_maps* maps = nullptr;
        check(svbrdf_maps_from_memory(&input, &maps));
        return Maps(maps);
    }

    /// Whether the material shows an optional lobe. Without it, the map of the lobe is StatusCode::no_lobe.
    bool has(Lobe lobe) const {
        svbrdf_lobes lobes = 0;
        check(svbrdf_maps_lobes(get(), &lobes));
        return (lobes & to_c(lobe)) != 0;
    }
    /// Linear values: three channels, one for roughness. Valid as long as these maps.
    MapView<float> floats(Map map) const {
        return view<float>(map, MapFormat::f32);
    }
    /// Four bytes a texel, as glTF wants them. Valid as long as these maps.
    MapView<std::uint8_t> rgba8(Map map) const {
        return view<std::uint8_t>(map, MapFormat::rgba8);
    }
    /// Three bytes a texel. Valid as long as these maps.
    MapView<std::uint8_t> rgb8(Map map) const {
        return view<std::uint8_t>(map, MapFormat::rgb8);
    }
    /// One byte a texel, of roughness. Valid as long as these maps.
    MapView<std::uint8_t> r8(Map map) const {
        return view<std::uint8_t>(map, MapFormat::r8);
    }
    /// Four half floats a texel, as bits. Valid as long as these maps.
    MapView<std::uint16_t> rgba16f(Map map) const {
        return view<std::uint16_t>(map, MapFormat::rgba16f);
    }
    /// Four floats a texel. Valid as long as these maps.
    MapView<float> rgba32f(Map map) const {
        return view<float>(map, MapFormat::rgba32f);
    }
    /// Copies a map; rows of `row_stride` bytes, 0: no gap.
    void copy(Map map, MapFormat format, void* data, std::size_t bytes,
              std::size_t row_stride = 0) const {
        check(svbrdf_maps_copy(get(), to_c(map), to_c(format), data, bytes, row_stride));
    }
    /// The maps at 1 / 2^level of their size.
    Maps reduced(std::uint32_t level) const {
        svbrdf_maps* small = nullptr;
        check(svbrdf_maps_reduced(get(), level, &small));
        return Maps(small);
    }
    /// Renders the maps into memory of the caller's; rows as in copy().
    void render(const svbrdf_render_options& options, MapFormat format, void* data,
                std::size_t bytes, std::size_t row_stride = 0) const {
        check(svbrdf_maps_render(get(), &options, to_c(format), data, bytes, row_stride));
    }
    /// The same as sRGB, four bytes a texel.
    std::vector<std::uint8_t> render(const svbrdf_render_options& options) const {
        const auto [width, height] = size();
        std::vector<std::uint8_t> rgba(std::size_t{4} * width * height);
        render(options, MapFormat::rgba8, rgba.data(), rgba.size());
        return rgba;
    }
    std::pair<std::uint32_t, std::uint32_t> size() const {
        std::uint32_t width = 0, height = 0;
        check(svbrdf_maps_size(get(), &width, &height, nullptr));
        return {width, height};
    }
    std::array<float, 2> sample_mm() const {
        std::array<float, 2> mm{};
        check(svbrdf_maps_size(get(), nullptr, nullptr, mm.data()));
        return mm;
    }
    /// Standard deviation of each map as a whole; of a Session::snapshot_with_uncertainty() only.
    svbrdf_uncertainty uncertainty() const {
        svbrdf_uncertainty found = make(svbrdf_uncertainty_init);
        check(svbrdf_maps_uncertainty(get(), &found));
        return found;
    }
    /// The same at every texel, one value each; of anisotropy, coat and the colour of sheen three, see
    /// svbrdf_maps_deviations(). Valid as long as these maps.
    MapView<float> deviations(Map map) const {
        svbrdf_map_view v = make(svbrdf_map_view_init);
        check(svbrdf_maps_deviations(get(), to_c(map), &v));
        return {Span<const float>(static_cast<const float*>(v.data), v.bytes / sizeof(float)),
                v.width, v.height, v.channels};
    }
    /// Writes PNG, EXR and a preview into a folder.
    void export_to(const std::string& path) const { check(svbrdf_maps_export(get(), nullptr, path.c_str())); }
    /// Files for other programs, e.g. "glb,usdz", into a folder: all of them or none.
    void export_formats(const std::string& path, const std::string& formats,
                        svbrdf_export_options options = make(svbrdf_export_options_init)) const {
        options.formats = formats.c_str();
        check(svbrdf_maps_export(get(), &options, path.c_str()));
    }
    /// The same in memory.
    Package package(const std::string& formats,
                    svbrdf_export_options options = make(svbrdf_export_options_init)) const {
        options.formats = formats.c_str();
        svbrdf_package* package = nullptr;
        check(svbrdf_maps_export_package(get(), &options, &package));
        return Package(package);
    }
    svbrdf_maps* get() const noexcept { return owner_.get(); }

private:
    template <typename T>
    MapView<T> view(Map map, MapFormat format) const {
        svbrdf_map_view v = make(svbrdf_map_view_init);
        check(svbrdf_maps_view(get(), to_c(map), to_c(format), &v));
        return {Span<const T>(static_cast<const T*>(v.data), v.bytes / sizeof(T)), v.width,
                v.height, v.channels};
    }
    detail::Owner<svbrdf_maps, svbrdf_maps_destroy> owner_;
};

/// A board as a file to be printed at 100 %; nullptr: the default one.
inline Buffer print_board(const svbrdf_board* board = nullptr, Page page = Page::a4,
                          SheetFormat format = SheetFormat::pdf) {
    svbrdf_buffer* buffer = nullptr;
    check(svbrdf_board_print(board, to_c(page), to_c(format), &buffer));
    return Buffer(buffer);
}

}  // namespace svbrdf

#endif
