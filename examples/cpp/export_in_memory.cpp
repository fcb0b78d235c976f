// Turns maps in memory into files of other programs, in memory.
//
//   export_in_memory
#include <cstdint>
#include <iostream>
#include <vector>

#include "svbrdf.hpp"

int main() {
    constexpr std::uint32_t side = 64;
    constexpr std::size_t texels = std::size_t{side} * side;
    std::vector<float> normal(3 * texels), diffuse(3 * texels, 0.3f), specular(3 * texels, 0.04f),
        roughness(texels);
    for (std::size_t i = 0; i < texels; i++) {
        normal[3 * i + 2] = 1.0f;
        roughness[i] = static_cast<float>(i % side) / static_cast<float>(side);
    }
    try {
        auto input = svbrdf::make(svbrdf_maps_input_init);
        input.width = input.height = side;
        input.normal = normal.data();
        input.diffuse = diffuse.data();
        input.specular = specular.data();
        input.roughness = roughness.data();
        const auto maps = svbrdf::Maps::from_memory(input);
        const svbrdf::Package package = maps.package("glb,unreal");
        // The bytes are valid as long as the package.
        for (const char* name : {"material.glb", "unreal/orm.png"}) {
            std::cout << name << ": " << package.bytes(name).size() << " bytes\n";
        }
        std::cout << package.count() << " files\n";
        return 0;
    } catch (const std::exception& fault) {
        std::cerr << fault.what() << "\n";
        return 1;
    }
}
