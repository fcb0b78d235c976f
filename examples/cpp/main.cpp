// Streams a capture folder into a session, as an app would its camera, and shows progress.
//
//   svbrdf-stream CAPTURE OUT [SECONDS PER PHOTO]
//
// OUT gets the maps, and session.state while photos come: after an interruption the program goes
// on from there.
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <mutex>
#include <string>

#include "svbrdf.hpp"

namespace {

// Progress comes on the session's thread, messages from ours.
class Terminal {
public:
    void progress(const svbrdf::Progress& p) {
        const std::lock_guard<std::mutex> lock(mutex_);
        std::printf("\r  %3.0f %%, error %.4f ", 100.0 * static_cast<double>(p.fraction),
                    static_cast<double>(p.loss));
        if (p.seconds_left) {
            std::printf("%.0f s left   ", static_cast<double>(*p.seconds_left));
        }
        std::fflush(stdout);
    }
    void line(const std::string& text) {
        const std::lock_guard<std::mutex> lock(mutex_);
        std::printf("\r%-60s\n", text.c_str());
    }

private:
    std::mutex mutex_;
};

// Where to take the next photo from, as a sentence.
std::string next_view(const svbrdf::Session& session) {
    const auto view = session.next_view();
    if (!view) {
        return {};
    }
    char text[100];
    std::snprintf(text, sizeof text, "next: %.0f degrees off the vertical, towards %.0f degrees",
                  static_cast<double>(view->tilt_deg), static_cast<double>(view->azimuth_deg));
    return text;
}

svbrdf::Session begin(const svbrdf::Capture& capture, const std::filesystem::path& state,
                      Terminal& terminal) {
    svbrdf::Callbacks callbacks;
    callbacks.progress = [&](svbrdf::SessionView, const svbrdf::Progress& p) {
        terminal.progress(p);
    };
    const auto options = svbrdf::make(svbrdf_session_options_init);
    if (std::filesystem::exists(state)) {
        try {
            auto session = svbrdf::Session::load(state.string(), options, callbacks);
            terminal.line("going on from " + state.string());
            return session;
        } catch (const svbrdf::Error& fault) {
            terminal.line(std::string("beginning anew: ") + fault.what());
        }
    }
    return svbrdf::Session(capture, options, callbacks);
}

int run(const std::string& folder, const std::filesystem::path& out, double seconds) {
    const svbrdf::Capture capture(folder);
    std::filesystem::create_directories(out);
    const auto state = out / "session.state";
    Terminal terminal;
    auto session = begin(capture, state, terminal);
    auto budget = svbrdf::make(svbrdf_budget_init);
    budget.seconds = static_cast<float>(seconds);
    session.set_budget(budget);
    session.wait();

    int used = 0;
    // Rejected photos are looked at again after an interruption; they are few.
    for (std::uint32_t i = session.progress().photos; i < capture.photos(); i++) {
        session.announce(capture.photos() - i);  // Some may not be readable.
        const std::string name = "photo " + std::to_string(i + 1);
        std::string hints;
        try {
            const auto outcome = session.add_photo(capture, i);
            if (!outcome) {
                terminal.line(name + " cannot be used: " + outcome.advice);
                continue;
            }
            hints = outcome.advice;
        } catch (const svbrdf::Error& fault) {
            if (fault.status() != svbrdf::StatusCode::invalid_argument) {
                throw;
            }
            terminal.line(name + " cannot be read: " + fault.what());
            continue;
        }
        used++;
        session.wait();
        terminal.line(name + " is in the maps" + (hints.empty() ? "" : "; " + hints));
        if (const std::string next = next_view(session); !next.empty()) {
            terminal.line("  " + next);
        }
        session.save(state.string());
    }
    const auto maps = session.snapshot();
    if (!maps) {
        std::cerr << "no photo could be used\n";
        return 2;
    }
    maps->export_to(out.string());
    std::filesystem::remove(state);
    std::cout << used << " photos, maps in " << out.string() << "\n";
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3 && argc != 4) {
        std::cerr << "usage: svbrdf-stream CAPTURE OUT [SECONDS PER PHOTO]\n";
        return 2;
    }
    try {
        return run(argv[1], argv[2], argc == 4 ? std::stod(argv[3]) : -1.0);
    } catch (const std::exception& fault) {
        std::cerr << fault.what() << "\n";
        return 1;
    }
}
