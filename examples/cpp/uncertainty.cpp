// Adds photos until the roughness is known well enough.
//
//   uncertainty CAPTURE DEVIATION [PHOTOS]
#include <algorithm>
#include <cstdint>
#include <iostream>
#include <limits>
#include <string>

#include "svbrdf.hpp"

int main(int argc, char** argv) {
    if (argc < 3) {
        std::cerr << "usage: uncertainty CAPTURE DEVIATION [PHOTOS]\n";
        return 2;
    }
    try {
        const svbrdf::Capture capture(argv[1]);
        const float enough = std::stof(argv[2]);
        svbrdf::Session session(capture, svbrdf::make(svbrdf_session_options_init));
        std::uint32_t photos = capture.photos(), i = 0;
        if (argc > 3) {
            photos = std::min(photos, static_cast<std::uint32_t>(std::stoul(argv[3])));
        }
        float known = std::numeric_limits<float>::infinity();
        for (; i < photos && known > enough; i++) {
            if (!session.add_photo(capture, i)) {
                continue;
            }
            // Deviations are meaningful once the fit has settled.
            session.wait();
            const auto maps = session.snapshot_with_uncertainty();
            known = maps->uncertainty().roughness;
            const auto texels = maps->deviations(svbrdf::Map::roughness);
            const auto unknown = std::count_if(texels.values.begin(), texels.values.end(),
                                               [&](float deviation) { return deviation > enough; });
            std::cout << "roughness within " << known << ", " << unknown << " of "
                      << texels.values.size() << " texels not within " << enough << "\n";
        }
        std::cout << i << " photos, roughness within " << known << "\n";
        return 0;
    } catch (const std::exception& fault) {
        std::cerr << fault.what() << "\n";
        return 1;
    }
}
