// The loop of a camera app: add a photo, show the maps and the next view.
//
//   live_loop CAPTURE [PHOTOS]
//
// The photos of a folder with capture.json stand for the camera. Only the end waits for the fit.
// docs/live-loop.md has the same with a preview.
#include <algorithm>
#include <cstdint>
#include <iostream>
#include <string>

#include "svbrdf.hpp"

int main(int argc, char** argv) {
    if (argc < 2) {
        std::cerr << "usage: live_loop CAPTURE [PHOTOS]\n";
        return 2;
    }
    try {
        const svbrdf::Capture capture(argv[1]);
        svbrdf::Session session(capture, svbrdf::make(svbrdf_session_options_init));
        std::uint32_t photos = capture.photos(), used = 0;
        if (argc > 2) {
            photos = std::min(photos, static_cast<std::uint32_t>(std::stoul(argv[2])));
        }
        session.announce(photos);
        for (std::uint32_t i = 0; i < photos; i++) {
            const auto outcome = session.add_photo(capture, i);
            if (!outcome) {
                std::cout << "try again: " << outcome.advice << "\n";
                continue;
            }
            used++;
            std::cout << "photo " << i + 1 << " is in the maps. " << outcome.advice << "\n";
            // The fit continues; its maps are there at any time.
            if (const auto maps = session.snapshot()) {
                std::cout << "  " << maps->size().first << " x " << maps->size().second << " texels\n";
            }
            if (const auto next = session.next_view()) {
                std::cout << "  next: " << next->tilt_deg << " degrees off the vertical, towards "
                          << next->azimuth_deg << " degrees\n";
            }
        }
        session.wait();
        std::cout << used << " photos used\n";
        return 0;
    } catch (const std::exception& fault) {
        std::cerr << fault.what() << "\n";
        return 1;
    }
}
