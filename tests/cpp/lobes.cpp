// Maps of values in memory, with and without anisotropy, a coat and sheen.
#include <cmath>
#include <initializer_list>
#include <vector>

#include "check.hpp"

using svbrdf::Map;
using svbrdf::StatusCode;

/// A material of one kind everywhere, with anisotropy, a coat and sheen.
void lobes(const std::string& folder) {
    constexpr std::uint32_t side = 8;
    constexpr std::size_t texels = std::size_t{side} * side;
    const auto everywhere = [](std::initializer_list<float> texel) {
        std::vector<float> values;
        for (std::size_t i = 0; i < texels; i++) {
            values.insert(values.end(), texel);
        }
        return values;
    };
    const auto normal = everywhere({0.0f, 0.0f, 1.0f}), colour = everywhere({0.5f, 0.4f, 0.3f});
    const auto roughness = everywhere({0.25f}), anisotropy = everywhere({0.6f, 0.8f, 0.5f});
    const auto coat = everywhere({0.75f, 0.1f, 0.0f});
    const auto sheen = everywhere({0.5f, 0.25f, 0.0f}), sheen_roughness = everywhere({0.6f});
    auto input = svbrdf::make(svbrdf_maps_input_init);
    input.width = input.height = side;
    input.normal = normal.data();
    input.diffuse = input.specular = colour.data();
    input.roughness = roughness.data();
    const auto plain = svbrdf::Maps::from_memory(input);
    CHECK(!plain.has(svbrdf::Lobe::anisotropy) && !plain.has(svbrdf::Lobe::coat));
    CHECK(thrown([&] { plain.floats(Map::coat); }) == StatusCode::no_lobe);
    CHECK(plain.floats(Map::roughness).values[9] == 0.25f);
    input.anisotropy = anisotropy.data();
    input.coat = coat.data();
    const auto maps = svbrdf::Maps::from_memory(input);
    CHECK(maps.has(svbrdf::Lobe::anisotropy) && maps.has(svbrdf::Lobe::coat));
    const auto close = [](float a, float b) { return std::abs(a - b) < 1e-4f; };
    const float* turned = maps.floats(Map::anisotropy).at(3, 5);
    CHECK(close(turned[0], 0.6f) && close(turned[1], 0.8f) && close(turned[2], 0.5f));
    CHECK(close(maps.floats(Map::roughness).values[11], 0.25f));
    CHECK(maps.floats(Map::coat).at(1, 1)[0] == 0.75f && maps.rgba8(Map::coat).at(7, 7)[0] == 191);
    CHECK(!maps.has(svbrdf::Lobe::sheen));
    input.sheen = sheen.data();
    input.sheen_roughness = sheen_roughness.data();
    const auto velvet = svbrdf::Maps::from_memory(input);
    CHECK(velvet.has(svbrdf::Lobe::sheen) && velvet.has(svbrdf::Lobe::coat));
    CHECK(velvet.floats(Map::sheen).at(2, 3)[1] == 0.25f);
    CHECK(velvet.floats(Map::sheen_roughness).values[9] == 0.6f);
    CHECK(velvet.rgba8(Map::sheen).at(0, 0)[0] == 188);
    CHECK(velvet.render(svbrdf::make(svbrdf_render_options_init)) !=
          maps.render(svbrdf::make(svbrdf_render_options_init)));
    CHECK(maps.render(svbrdf::make(svbrdf_render_options_init)) !=
          plain.render(svbrdf::make(svbrdf_render_options_init)));
    CHECK(maps.reduced(1).has(svbrdf::Lobe::coat));
    maps.export_to(folder + "/cpp-lobes");
    CHECK(maps.package("glb").bytes("material.glb").size() > 1000);
    input.height = 0;
    CHECK(thrown([&] { svbrdf::Maps::from_memory(input); }) == StatusCode::invalid_argument);
}
