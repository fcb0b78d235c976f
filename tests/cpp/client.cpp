// A C++17 client that does everything svbrdf.hpp offers: client TEST FOLDER.
#include "check.hpp"
#include "svbrdf.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <future>
#include <iostream>
#include <iterator>
#include <memory>
#include <thread>
#include <type_traits>
#include <vector>

using svbrdf::Hint;
using svbrdf::Map;
using svbrdf::MapFormat;
using svbrdf::Rejection;
using svbrdf::StatusCode;
using svbrdf::to_c;

namespace {

/// Waits for another thread, at most ten minutes.
template <typename Condition>
void eventually(Condition condition) {
    for (int left = 600000; !condition(); left--) {
        CHECK(left > 0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

struct Picture {
    std::vector<std::uint8_t> rgb;
    std::uint32_t width = 0, height = 0;
    svbrdf_image view() const { return svbrdf::rgb8(rgb.data(), width, height); }
};

Picture read_ppm(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::string magic, full;
    Picture picture;
    file >> magic >> picture.width >> picture.height >> full;
    CHECK(magic == "P6" && full == "255" && file.get() == '\n');
    picture.rgb.resize(std::size_t{3} * picture.width * picture.height);
    file.read(reinterpret_cast<char*>(picture.rgb.data()),
              static_cast<std::streamsize>(picture.rgb.size()));
    CHECK(file.good());
    return picture;
}

svbrdf_session_options rectified() {
    auto options = svbrdf::make(svbrdf_session_options_init);
    options.scene = to_c(svbrdf::Scene::rectified);
    options.threads = 1;
    return options;
}

Picture gray() {
    Picture picture;
    picture.width = picture.height = 256;
    picture.rgb.assign(3 * 256 * 256, 110);
    return picture;
}

const std::array<float, 3> above{0.0f, 10.0f, 150.0f};

void board(const std::string& folder) {
    auto board = svbrdf::make(svbrdf_board_init);
    board.rows = 19;
    board.cols = 14;
    board.square_mm = 10.0;
    board.hole_row_start = 3;
    board.hole_col_start = 2;
    board.hole_row_end = 16;
    board.hole_col_end = 12;
    board.patches = 0;
    auto camera = svbrdf::make(svbrdf_camera_init);
    camera.width = 2016;
    camera.height = 1512;
    camera.fx = 1493.9383274679394;
    camera.fy = 1492.8832900664995;
    camera.cx = 1014.8386867404545;
    camera.cy = 755.2944690154574;
    camera.distortion[0] = 0.0421587926023828;
    camera.distortion[1] = -0.042918096580716374;
    const std::array<double, 3> flash{4.9223925516757925, 7.8090039183605695, 0.0};
    auto options = svbrdf::make(svbrdf_session_options_init);
    options.board = &board;
    options.camera = &camera;
    options.flash_offset_mm = flash.data();
    options.sample_mm[0] = options.sample_mm[1] = 88.0f;

    std::atomic<int> progressed{0}, mapped{0}, logged{0};
    svbrdf::Callbacks callbacks;
    callbacks.progress = [&](svbrdf::SessionView view, const svbrdf::Progress& progress) {
        CHECK(view.progress().photos <= 3 && progress.photos <= 3);
        CHECK(progress.fraction >= 0.0f && progress.fraction <= 1.0f);
        ++progressed;
        throw std::runtime_error("dropped at the boundary");
    };
    callbacks.maps = [&](svbrdf::SessionView view) { mapped += view.snapshot().has_value(); };
    callbacks.log = [&](svbrdf::LogLevel, const char* line) {
        std::cout << line << "\n";
        ++logged;
    };
    svbrdf::Session session(options, callbacks);
    CHECK(!session.snapshot() && !session.next_view());
    session.pause();
    session.announce(3);
    std::optional<Picture> first;
    for (const char* name : {"/00.ppm", "/01.ppm"}) {
        const Picture photo = read_ppm(folder + name);
        const auto probe = session.probe(photo.view());
        CHECK(probe && probe.advice.empty() && probe.report.has_pose == 1);
        CHECK(probe.corners.size() == probe.report.corners_found && probe.corners.size() > 60);
        if (!first) {
            session.begin_guide();
            auto when = svbrdf::make(svbrdf_photo_info_init);
            CHECK(session.guide(photo.view(), when).action == svbrdf::Action::hold);
            when.timestamp_ns = 200000000;
            const auto guided = session.guide(photo.view(), when);
            CHECK(guided.action == svbrdf::Action::shoot && !guided.message.empty());
            CHECK(guided.probe && guided.probe.corners.size() == probe.corners.size());
        }
        const auto outcome = session.add_photo(photo.view());
        CHECK(outcome && outcome.advice.empty() && outcome.report.has_pose == 1);
        CHECK(!outcome.has(Hint::nothing_new));
        first = first ? first : photo;
    }
    const auto next = session.next_view();
    CHECK(next && next->direction[2] > 0.5f && next->tilt_deg < 60.0f);
    CHECK(session.camera() && std::abs(session.camera()->fx - camera.fx) < 1e-9);
    CHECK(session.paper() && session.paper()->aspect == 1.0 && session.paper()->elevation_mm == 0.0);
    CHECK(session.pose(1).translation_mm[2] > 50.0 && session.pose(1).reprojection_rms_px < 1.0);
    CHECK(thrown([&] { session.pose(2); }) == StatusCode::invalid_argument);
    CHECK(session.probe(first->view()).has(Hint::nothing_new));
    CHECK(session.photo_fit(1).weight > 0.3f && session.photo_fit(1).outlier == 0);
    const auto trusted = session.snapshot_with_uncertainty();
    CHECK(trusted && trusted->uncertainty().roughness > 0.0f);
    CHECK(trusted->deviations(Map::normal).channels == 1);
    CHECK(thrown([&] { session.snapshot()->uncertainty(); }) == StatusCode::invalid_argument);
    CHECK(thrown([&] { session.photo_fit(2); }) == StatusCode::invalid_argument);
    CHECK(thrown([&] { session.remove_photo(2); }) == StatusCode::invalid_argument);
    CHECK(session.add_photo(first->view()) && session.progress().photos == 3);
    const auto hints = session.hints();
    const auto same = [](const svbrdf::PhotoHint& hint) {
        return hint.index == 2 && hint.code == "nothing_new" && !hint.text.empty();
    };
    CHECK(std::count_if(hints.begin(), hints.end(), same) == 1);
    CHECK(session.progress().fraction == 0.0f);
    session.remove_photo(2);
    CHECK(session.progress().photos == 2);
    std::promise<svbrdf::Outcome> later;
    session.add_photo_async(first->view(), [&](svbrdf::SessionView view, StatusCode status,
                                          const svbrdf::Outcome& outcome) {
        CHECK(status == StatusCode::ok && view.progress().photos == 3);
        later.set_value(outcome);
        throw std::runtime_error("dropped at the boundary");
    });
    const auto answer = later.get_future().get();
    CHECK(answer && answer.has(Hint::nothing_new) && answer.report.index == 2);
    session.remove_photo(2);
    // All of its light was there without the flash: no board is left.
    const auto without = first->view();
    auto info = svbrdf::make(svbrdf_photo_info_init);
    info.ambient = &without;
    const auto nothing_left = session.add_photo(first->view(), &info);
    CHECK(!nothing_left && nothing_left.rejection == Rejection::board_not_found);
    Picture black = gray();
    CHECK(session.probe(black.view()).rejection == Rejection::board_not_found);
    const auto refused = session.add_photo(black.view());
    CHECK(!refused && refused.rejection == Rejection::wrong_size);
    CHECK(refused.advice.find("2016x1512") != std::string::npos);
    CHECK(!session.wait_for(std::chrono::milliseconds(20)));
    CHECK(session.progress().state == svbrdf::State::paused && session.progress().photos == 2);
    session.resume();
    session.wait();
    CHECK(session.wait_for(std::chrono::milliseconds(0)) && session.progress().fraction == 1.0f);
    CHECK(std::abs(session.light().first[0] - flash[0]) < 0.01);

    const auto maps = session.snapshot();
    CHECK(maps && maps->size() == std::make_pair(256u, 256u) && maps->sample_mm()[0] == 88.0f);
    const auto normal = maps->floats(Map::normal);
    CHECK(normal.channels == 3 && normal.at(10, 20)[2] > 0.0f);
    CHECK(maps->rgba8(Map::roughness).at(0, 0)[0] == 255);
    CHECK(maps->rgb8(Map::diffuse).values.size() == 3 * 256 * 256);
    std::vector<float> copy(256 * 256);
    maps->copy(Map::roughness, MapFormat::f32, copy.data(), 4 * copy.size());
    CHECK(copy[300] == maps->floats(Map::roughness).values[300]);
    CHECK(maps->r8(Map::roughness).values[7] == maps->rgba8(Map::roughness).at(7, 0)[1]);
    CHECK(maps->rgba16f(Map::normal_directx).at(3, 3)[3] == 0x3C00);
    CHECK(maps->rgba32f(Map::diffuse).at(3, 3)[1] == maps->floats(Map::diffuse).at(3, 3)[1]);
    CHECK(maps->reduced(2).size().first == 64 && session.snapshot()->reduced(1).size().second == 128);
    CHECK(thrown([&] { maps->reduced(9); }) == StatusCode::invalid_argument);
    auto light = svbrdf::make(svbrdf_render_options_init);
    light.light_mm[0] = 50.0f;
    const std::vector<std::uint8_t> lit = maps->reduced(1).render(light);
    CHECK(lit.size() == 4 * 128 * 128 && lit[3] == 255 && lit[0] > 0);
    std::vector<float> linear(3 * 256 * 256);
    maps->render(light, MapFormat::f32, linear.data(), 4 * linear.size());
    CHECK(linear[0] > 0.0f);
    maps->export_to(folder + "/cpp");
    const svbrdf::Package package = maps->package("glb,unreal");
    const auto glb = package.bytes("material.glb");
    CHECK(package.count() > 5 && glb.size() > 1000 && glb.data()[0] == 'g');
    CHECK(package.bytes("unreal/orm.png").size() > 100 && package.bytes("none").size() == 0);
    auto exported = svbrdf::make(svbrdf_export_options_init);
    exported.max_size = 32;
    maps->export_formats(folder + "/cpp/export", "usdz", exported);
    CHECK(thrown([&] { maps->package("gltf"); }) == StatusCode::invalid_argument);
    eventually([&] { return progressed > 0 && mapped > 0; });
    svbrdf::Session moved = std::move(session);
    CHECK(session.get() == nullptr && moved.progress().settled);
    moved.cancel();
    CHECK(thrown([&] { moved.wait(); }) == StatusCode::ok);  // It had settled.
    CHECK(thrown([&] { moved.add_photo(black.view()); }) == StatusCode::cancelled);
    CHECK(logged >= 4);
}

std::vector<std::uint8_t> read_bytes(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    CHECK(file.good());
    return {std::istreambuf_iterator<char>(file), {}};
}

void handles(const std::string& folder) {
    static_assert(!std::is_copy_constructible_v<svbrdf::Session>);
    static_assert(std::is_nothrow_move_constructible_v<svbrdf::Session>);
    static_assert(!std::is_copy_constructible_v<svbrdf::Maps>);
    static_assert(std::is_nothrow_move_assignable_v<svbrdf::Models>);
    const auto bytes = [](const std::vector<std::uint8_t>& v) {
        return svbrdf::Span<const std::uint8_t>(v.data(), v.size());
    };
    const auto decoder = read_bytes(folder + "/models/decoder.bin");
    const auto encoder = read_bytes(folder + "/models/encoder.onnx");
    const auto photo = read_bytes(folder + "/models/photo.onnx");
    const auto completion = read_bytes(folder + "/models/completion.onnx");
    auto models = svbrdf::Models::from_memory(bytes(decoder), bytes(encoder), bytes(photo),
                                              bytes(completion));
    models = svbrdf::Models::from_folder(folder + "/models");
    auto options = rectified();
    options.models = models.get();
    std::vector<svbrdf::Session> sessions;
    std::atomic<int> calls{0};
    for (int i = 0; i < 8; i++) {
        svbrdf::Callbacks callbacks;
        callbacks.progress = [&](svbrdf::SessionView, const svbrdf::Progress&) { ++calls; };
        sessions.emplace_back(options, callbacks);
    }
    std::optional<svbrdf::Maps> maps;
    for (auto& session : sessions) {
        CHECK(session.add_rectified_photo(gray().view(), above, above));
        maps = session.snapshot();
    }
    eventually([&] { return calls > 0; });
    sessions.erase(sessions.begin() + 2, sessions.end() - 1);  // Ended during their fits.
    sessions[0] = std::move(sessions[2]);
    sessions.clear();
    CHECK(maps->floats(Map::diffuse).at(3, 3)[0] >= 0.0f);
}

void state(const std::string& folder) {
    auto budget = svbrdf::make(svbrdf_budget_init);
    budget.max_steps = 4;
    std::atomic<int> logged{0};
    svbrdf::Session session(rectified());
    session.set_budget(budget);
    CHECK(session.add_rectified_photo(gray().view(), above, above));
    session.wait();
    const svbrdf::Buffer saved = session.save();
    session.save(folder + "/cpp.state");
    svbrdf::Callbacks callbacks;
    callbacks.log = [&](svbrdf::LogLevel, const char*) { ++logged; };
    auto again = svbrdf::Session::load(saved.bytes(), svbrdf::make(svbrdf_session_options_init),
                                       std::move(callbacks));
    CHECK(again.progress().photos == 1 && logged == 1);
    CHECK(again.add_rectified_photo(gray().view(), above, above));
    again.clear_budget();
    again = svbrdf::Session::load(folder + "/cpp.state");
    const auto maps = again.snapshot();
    CHECK(maps && maps->size().first == 256);
    const auto bytes = saved.bytes();
    const svbrdf::Span<const std::uint8_t> half(bytes.data(), bytes.size() / 2);
    CHECK(thrown([&] { svbrdf::Session::load(half); }) == StatusCode::bad_state);
    auto options = svbrdf::make(svbrdf_session_options_init);
    options.memory_limit_bytes = 1;
    CHECK(thrown([&] { svbrdf::Session::load(bytes, options); }) == StatusCode::memory_limit);
}

void capture(const std::string& folder) {
    const svbrdf::Capture capture(folder + "/capture");
    CHECK(capture.photos() == 8);
    svbrdf::Session session(capture, svbrdf::make(svbrdf_session_options_init));
    session.pause();
    CHECK(session.add_photo(capture, 0));
    const auto again = session.add_photo(capture, 0);
    CHECK(again && again.has(Hint::nothing_new) && again.report.same_view_as == 0);
    CHECK(again.advice.find("photo 1 has") == 0);
    CHECK(session.snapshot() && session.next_view());
    CHECK(thrown([&] { session.add_photo(capture, 99); }) == StatusCode::invalid_argument);
    const auto file = read_bytes(folder + "/capture/frames/01.jpg");
    auto info = svbrdf::make(svbrdf_file_info_init);
    CHECK(session.add_photo_file({file.data(), file.size()}, nullptr, &info));
    CHECK(info.width == 2016 && info.height == 1512);
    CHECK(thrown([&] { session.add_photo_file({file.data(), 5}); }) == StatusCode::invalid_argument);
    CHECK(thrown([] { svbrdf::Capture none("/nowhere"); }) == StatusCode::io);
}

/// A session that one of its callbacks destroys. The callback then still uses its own memory.
struct Ended {
    std::promise<std::string> last_word;
    std::unique_ptr<svbrdf::Session> session;

    /// Memory of the callback's own: gone when the callback is freed while it runs.
    std::function<void()> ending() {
        return [this, word = std::string(100, 'w')] {
            session.reset();
            last_word.set_value(word);
        };
    }
};

void destroyed_inside(const std::string&) {
    const Picture picture = gray();
    enum Where { in_progress, in_maps, in_log, in_pushed };
    for (const Where where : {in_progress, in_maps, in_log, in_pushed}) {
        // Outlives the threads of the session.
        static std::array<Ended, 4> all;
        Ended& ended = all[where];
        std::atomic<bool> armed{false};
        const auto end = ended.ending();
        const auto once = [&armed, end] {
            const bool now = armed.exchange(false);
            if (now) {
                end();
            }
            return now;
        };
        svbrdf::Callbacks callbacks;
        if (where == in_progress) {
            callbacks.progress = [once](svbrdf::SessionView view, const svbrdf::Progress&) {
                CHECK(!once() || thrown([&] { view.pause(); }) == StatusCode::invalid_handle);
            };
        } else if (where == in_maps) {
            callbacks.maps = [once](svbrdf::SessionView) { once(); };
        } else if (where == in_log) {
            callbacks.log = [once](svbrdf::LogLevel, const char*) { once(); };
        }
        ended.session = std::make_unique<svbrdf::Session>(rectified(), std::move(callbacks));
        armed = true;
        if (where == in_pushed) {
            ended.session->add_photo_async(
                picture.view(), [once](svbrdf::SessionView view, StatusCode, const svbrdf::Outcome&) {
                    once();
                    CHECK(thrown([&] { view.pause(); }) == StatusCode::invalid_handle);
                });
        } else {
            // The photo may be in the maps before the session ends, or not.
            const auto met =
                thrown([&] { ended.session->add_rectified_photo(picture.view(), above, above); });
            CHECK(met == StatusCode::ok || met == StatusCode::cancelled);
        }
        CHECK(ended.last_word.get_future().get() == std::string(100, 'w'));
    }
}

/// Each way to describe a picture gives the same photo.
void pixel_formats(const std::string&) {
    constexpr std::uint32_t width = 5, height = 3, gap = 4;
    std::vector<float> floats(4 * (width + gap) * height);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(floats.data());
    const auto* words = reinterpret_cast<const std::uint16_t*>(floats.data());
    const auto same = [&](const svbrdf_image& image, svbrdf::PixelFormat format, std::size_t pixel,
                          std::size_t gap_bytes) {
        CHECK(image.format == to_c(format) && image.width == width && image.height == height);
        CHECK(image.planes[0].row_stride == pixel * width + gap_bytes);
        CHECK(image.planes[0].bytes == image.planes[0].row_stride * (height - 1) + pixel * width);
        CHECK(pixel == svbrdf::pixel_bytes(format));
    };
    using svbrdf::PixelFormat;
    using svbrdf::Transfer;
    same(svbrdf::rgb8(bytes, width, height), PixelFormat::rgb8, 3, 0);
    same(svbrdf::rgba8(bytes, width, height, Transfer::srgb, 4 * width + gap), PixelFormat::rgba8, 4, gap);
    same(svbrdf::bgra8(bytes, width, height), PixelFormat::bgra8, 4, 0);
    same(svbrdf::rgb16(words, width, height, Transfer::linear, 6 * width + gap), PixelFormat::rgb16, 6, gap);
    same(svbrdf::rgba16(words, width, height), PixelFormat::rgba16, 8, 0);
    same(svbrdf::rgba_f16(words, width, height, 2.0f), PixelFormat::rgba_f16, 8, 0);
    same(svbrdf::rgb_f32(floats.data(), width, height), PixelFormat::rgb_f32, 12, 0);
    same(svbrdf::rgba_f32(floats.data(), width, height), PixelFormat::rgba_f32, 16, 0);
    svbrdf::Sensor sensor;
    sensor.pattern = svbrdf::BayerPattern::bggr;
    sensor.black_level = {1, 2, 3, 4};
    sensor.color_matrix[5] = 0.5f;
    const auto raw = svbrdf::bayer16(words, width, height, sensor);
    same(raw, PixelFormat::bayer16, 2, 0);
    CHECK(raw.black_level[3] == 4.0f && raw.color_matrix[5] == 0.5f && raw.white_balance[2] == 1.0f);
    CHECK(raw.bayer_pattern == SVBRDF_BAYER_BGGR && raw.white_level == 65535.0f);
}

/// The same gray in the layouts of 4:2:0 and in those of RGB: every one is read to the same maps.
void pictures_of_one_gray(const std::string&) {
    constexpr std::uint32_t side = 256;
    constexpr std::uint8_t level = 110;
    const std::vector<std::uint8_t> bytes(4 * side * side, level), neutral(side * side / 2, 128);
    const std::vector<std::uint16_t> words(4 * side * side, level * 257), ten(side * side, level << 8);
    const std::vector<std::uint16_t> grey(side * side / 2, 512 << 6);
    const auto* u = neutral.data();
    std::optional<float> expected;
    for (const svbrdf_image& image : {
             svbrdf::rgb8(bytes.data(), side, side), svbrdf::rgba8(bytes.data(), side, side),
             svbrdf::bgra8(bytes.data(), side, side), svbrdf::rgb16(words.data(), side, side),
             svbrdf::rgba16(words.data(), side, side), svbrdf::nv12(bytes.data(), 0, u, 0, side, side),
             svbrdf::nv21(bytes.data(), 0, u, 0, side, side),
             svbrdf::i420(bytes.data(), 0, u, u + side * side / 4, 0, side, side),
             svbrdf::p010(ten.data(), 0, grey.data(), 0, side, side, svbrdf::YuvMatrix::bt709_full),
         }) {
        svbrdf::Session session(rectified());
        session.pause();
        CHECK(session.add_rectified_photo(image, above, above));
        const float found = session.snapshot()->floats(Map::diffuse).at(128, 128)[1];
        expected = expected.value_or(found);
        // 10 bits round elsewhere than 8 do: a step of 10 bits.
        CHECK(std::abs(found - *expected) < 0.004f);
    }
}

void bad_arguments(const std::string&) {
    const auto pdf = svbrdf::print_board();
    CHECK(pdf.bytes().size() > 1000 && pdf.bytes()[0] == '%');
    CHECK(thrown([] { svbrdf::print_board(nullptr, svbrdf::Page{7}); }) == StatusCode::invalid_argument);
    auto options = rectified();
    options.resolution = 7;
    CHECK(thrown([&] { svbrdf::Session session(options); }) == StatusCode::invalid_argument);
    CHECK(thrown([] { svbrdf::Models::from_folder("/nowhere"); }) == StatusCode::io);
    svbrdf::Session session(rectified());
    auto image = gray().view();
    image.planes[0].data = nullptr;
    CHECK(thrown([&] { session.add_rectified_photo(image, above, above); }) == StatusCode::invalid_argument);
    CHECK(thrown([&] { session.probe(gray().view()); }) == StatusCode::invalid_argument);
    CHECK(!session.next_view() && !session.camera() && !session.paper());
    CHECK(!session.snapshot() && !session.snapshot_with_uncertainty());
    const auto never = [](svbrdf::SessionView, StatusCode, const svbrdf::Outcome&) { CHECK(false); };
    CHECK(thrown([&] { session.add_photo_async(image, never); }) == StatusCode::invalid_argument);
    // A photo of a board, for a session of photos from the top.
    std::promise<std::string> advice;
    const auto refused = [&](svbrdf::SessionView, StatusCode status, const svbrdf::Outcome& outcome) {
        CHECK(status == StatusCode::invalid_argument && !outcome);
        advice.set_value(outcome.advice);
    };
    const Picture picture = gray();
    session.add_photo_async(picture.view(), refused);
    CHECK(!advice.get_future().get().empty());
    svbrdf::Session other = std::move(session);
    CHECK(thrown([&] { session.pause(); }) == StatusCode::invalid_handle);
}

}  // namespace

int main(int argc, char** argv) {
    CHECK(argc == 3);
    const std::string test = argv[1], folder = argv[2];
    if (test == "board") {
        board(folder);
    } else if (test == "handles") {
        handles(folder);
    } else if (test == "lobes") {
        lobes(folder);
    } else if (test == "state") {
        state(folder);
    } else if (test == "capture") {
        capture(folder);
    } else if (test == "destroyed-inside") {
        destroyed_inside(folder);
    } else if (test == "pixel-formats") {
        pixel_formats(folder);
        pictures_of_one_gray(folder);
    } else if (test == "bad-arguments") {
        bad_arguments(folder);
    } else {
        std::cerr << "no test " << test << "\n";
        return 1;
    }
    std::cout << test << ": done\n";
    return 0;
}
