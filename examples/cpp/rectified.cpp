// Maps from photos in memory that are rectified already, each with the positions of camera and light.
//
//   rectified
//
// The photos are rendered from known maps, with which the result is compared.
#include <array>
#include <cmath>
#include <cstdint>
#include <iostream>
#include <vector>

#include "svbrdf.hpp"

namespace {

constexpr std::uint32_t side = 256;
constexpr std::size_t texels = std::size_t{side} * side;

// Stripes of a matte material.
svbrdf::Maps known_maps() {
    std::vector<float> normal(3 * texels), diffuse(3 * texels), specular(3 * texels, 0.04f);
    const std::vector<float> roughness(texels, 0.6f);
    for (std::size_t i = 0; i < texels; i++) {
        normal[3 * i + 2] = 1.0f;
        for (std::size_t c = 0; c < 3; c++) {
            diffuse[3 * i + c] = (i % side / 32 + c) % 2 == 0 ? 0.4f : 0.15f;
        }
    }
    auto input = svbrdf::make(svbrdf_maps_input_init);
    input.width = input.height = side;
    input.normal = normal.data();
    input.diffuse = diffuse.data();
    input.specular = specular.data();
    input.roughness = roughness.data();
    return svbrdf::Maps::from_memory(input);
}

// Linear values of a photo by a camera and a flash at `mm` above the sample.
std::vector<float> pixels(const svbrdf::Maps& maps, const std::array<float, 3>& mm) {
    auto options = svbrdf::make(svbrdf_render_options_init);
    for (std::size_t i = 0; i < 3; i++) {
        options.camera_mm[i] = options.light_mm[i] = mm[i];
    }
    std::vector<float> values(4 * texels);
    maps.render(options, svbrdf::MapFormat::rgba32f, values.data(), 4 * values.size());
    return values;
}

}  // namespace

int main() {
    try {
        const svbrdf::Maps truth = known_maps();
        auto options = svbrdf::make(svbrdf_session_options_init);
        options.scene = to_c(svbrdf::Scene::rectified);
        svbrdf::Session session(options);
        const std::array<std::array<float, 3>, 3> places{
            {{0.0f, 0.0f, 150.0f}, {60.0f, 0.0f, 140.0f}, {-50.0f, 50.0f, 140.0f}}};
        for (const auto& mm : places) {
            const auto values = pixels(truth, mm);
            session.add_rectified_photo(svbrdf::rgba_f32(values.data(), side, side), mm, mm);
        }
        session.wait();
        const auto maps = session.snapshot();
        const auto found = maps->floats(svbrdf::Map::diffuse).values;
        const auto known = truth.floats(svbrdf::Map::diffuse).values;
        double sum = 0.0;
        for (std::size_t i = 0; i < found.size(); i++) {
            sum += std::pow(static_cast<double>(found[i]) - static_cast<double>(known[i]), 2);
        }
        std::cout << "diffuse albedo off by " << std::sqrt(sum / static_cast<double>(found.size())) << "\n";
        return 0;
    } catch (const std::exception& fault) {
        std::cerr << fault.what() << "\n";
        return 1;
    }
}
