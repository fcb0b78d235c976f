// Part of svbrdf.hpp: captures in progress, and the networks that they use.
#ifndef SVBRDF_SESSION_HPP
#define SVBRDF_SESSION_HPP

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core.hpp"
#include "maps.hpp"

namespace svbrdf {

/// Networks that sessions share.
class Models {
public:
    static Models from_folder(const std::string& path) {
        svbrdf_models* models = nullptr;
        check(svbrdf_models_from_folder(path.c_str(), &models));
        return Models(models);
    }
    static Models from_memory(Span<const std::uint8_t> decoder, Span<const std::uint8_t> encoder,
                              Span<const std::uint8_t> photo,
                              Span<const std::uint8_t> completion) {
        svbrdf_models* models = nullptr;
        check(svbrdf_models_from_memory(decoder.data(), decoder.size(), encoder.data(),
                                        encoder.size(), photo.data(), photo.size(),
                                        completion.data(), completion.size(), &models));
        return Models(models);
    }
    svbrdf_models* get() const noexcept { return owner_.get(); }

private:
    explicit Models(svbrdf_models* models) noexcept : owner_(models) {}
    detail::Owner<svbrdf_models, svbrdf_models_destroy> owner_;
};

/// A folder with capture.json and photos.
class Capture {
public:
    explicit Capture(const std::string& path) {
        svbrdf_capture* capture = nullptr;
        check(svbrdf_capture_open(path.c_str(), &capture));
        owner_ = detail::Owner<svbrdf_capture, svbrdf_capture_destroy>(capture);
    }
    /// Number of photos.
    std::uint32_t frames() const {
        std::uint32_t count = 0;
        check(svbrdf_capture_frames(get(), &count));
        return count;
    }
    svbrdf_capture* get() const noexcept { return owner_.get(); }

private:
    detail::Owner<svbrdf_capture, svbrdf_capture_destroy> owner_;
};

/// What became of a photo.
struct Pushed {
    /// Whether it takes part in the fit.
    bool accepted;
    /// Why not: one of SVBRDF_REJECTION_.
    svbrdf_rejection rejection;
    /// What to tell the user: why not, or hints about an accepted photo; empty without any.
    std::string advice;
    /// Pose, hints and figures.
    svbrdf_frame_report report;
    /// Whether a hint was given: one of SVBRDF_HINT_.
    bool has(svbrdf_hints hint) const noexcept { return (report.hints & hint) != 0; }
    explicit operator bool() const noexcept { return accepted; }
};

/// Called with what became of a photo that was pushed without waiting.
using PushedCallback = std::function<void(svbrdf_status, const Pushed&)>;

/// Where the board lies in a photo.
struct Pose {
    /// From the board to the camera, row by row.
    std::array<double, 9> rotation{};
    /// Board origin in the camera frame, mm.
    std::array<double, 3> translation_mm{};
    /// Error of the board's corners, px.
    double reprojection_rms_px = 0.0;
};

/// What a photo that was only looked at would be good for.
struct Probe {
    /// Whether a photo like it would be accepted.
    bool acceptable;
    /// Why not: one of SVBRDF_REJECTION_.
    svbrdf_rejection rejection;
    /// What to tell the user: why not, or hints; empty without any.
    std::string advice;
    /// Pose, view, blur, light and figures.
    svbrdf_probe report;
    /// Corners of the board that were found: x and y, px.
    std::vector<std::array<float, 2>> corners;
    /// Whether a hint was given: one of SVBRDF_HINT_.
    bool has(svbrdf_hints hint) const noexcept { return (report.hints & hint) != 0; }
    explicit operator bool() const noexcept { return acceptable; }
};

/// What to do now, see Session::guide().
struct Guidance {
    /// One of SVBRDF_ACTION_.
    svbrdf_action action;
    /// For the user.
    std::string message;
    /// The target and what photos from here and from there would tell.
    svbrdf_guidance report;
    /// The picture that was judged.
    Probe probe;
};

/// Functions a session calls on its own thread (log also on yours). They may use the session's
/// C handle; what they throw is dropped.
struct Callbacks {
    std::function<void(svbrdf_session*, const svbrdf_progress&)> progress;
    std::function<void(svbrdf_session*)> maps;
    std::function<void(svbrdf_log_level, const char*)> log;
};

/// A capture in progress. Its destructor may run at any time; see svbrdf_session_destroy().
class Session {
public:
    /// `callbacks` take the place of those of `options`.
    explicit Session(svbrdf_session_options options, Callbacks callbacks = {}) {
        open(options, std::move(callbacks), [&](svbrdf_session** session) {
            return svbrdf_session_create(&options, session);
        });
    }
    /// With scene, sample, board, camera and flash of a capture.
    Session(const Capture& capture, svbrdf_session_options options, Callbacks callbacks = {}) {
        open(options, std::move(callbacks), [&](svbrdf_session** session) {
            return svbrdf_session_create_for_capture(&options, capture.get(), session);
        });
    }
    /// Goes on with a saved session; see svbrdf_session_load_state() for what counts of `options`.
    static Session load(Span<const std::uint8_t> state,
                        svbrdf_session_options options = make(svbrdf_session_options_init),
                        Callbacks callbacks = {}) {
        Session session;
        session.open(options, std::move(callbacks), [&](svbrdf_session** handle) {
            return svbrdf_session_load_state(&options, state.data(), state.size(), handle);
        });
        return session;
    }
    /// The same from a file.
    static Session load(const std::string& path,
                        svbrdf_session_options options = make(svbrdf_session_options_init),
                        Callbacks callbacks = {}) {
        Session session;
        session.open(options, std::move(callbacks), [&](svbrdf_session** handle) {
            return svbrdf_session_load_state_from(&options, path.c_str(), handle);
        });
        return session;
    }
    Session(Session&&) noexcept = default;
    Session& operator=(Session&& other) noexcept {
        // The session goes before the functions it calls.
        owner_ = std::move(other.owner_);
        callbacks_ = std::move(other.callbacks_);
        return *this;
    }

    /// Takes a photo of a board in.
    Pushed push(const svbrdf_image& image, const svbrdf_frame_info* info = nullptr) {
        svbrdf_frame_report report = make(svbrdf_frame_report_init);
        return pushed(svbrdf_session_push_frame(get(), &image, info, &report), report);
    }
    /// As push(), without waiting: `done` is called exactly once on a thread of the session, with
    /// SVBRDF_OK, SVBRDF_REJECTED, or a fault, whose message is the advice. It may use this session,
    /// which must not be moved until then. What it throws is dropped. When this throws, it is not called.
    void push_async(const svbrdf_image& image, PushedCallback done,
                    const svbrdf_frame_info* info = nullptr) {
        auto held = std::make_unique<PushedCallback>(std::move(done));
        check(svbrdf_session_push_frame_async(get(), &image, info, on_pushed, held.get()));
        held.release();
    }
    /// Takes a photo from the top in, with camera and light in mm.
    Pushed push_rectified(const svbrdf_image& image, const std::array<float, 3>& camera_mm,
                          const std::array<float, 3>& light_mm,
                          const svbrdf_frame_info* info = nullptr) {
        svbrdf_frame_report report = make(svbrdf_frame_report_init);
        return pushed(svbrdf_session_push_rectified(get(), &image, info, camera_mm.data(),
                                                    light_mm.data(), &report),
                      report);
    }
    /// Takes in a photo of a board that is a file in memory, see svbrdf_session_push_encoded(); what it
    /// says of how it was taken goes to `info`.
    Pushed push_encoded(const void* bytes, std::size_t length,
                        const svbrdf_encoded_options* options = nullptr,
                        svbrdf_file_info* info = nullptr) {
        svbrdf_frame_report report = make(svbrdf_frame_report_init);
        return pushed(
            svbrdf_session_push_encoded(get(), bytes, length, options, info, &report), report);
    }
    /// Reads a capture's photo and takes it in.
    Pushed push(const Capture& capture, std::uint32_t index) {
        svbrdf_frame_report report = make(svbrdf_frame_report_init);
        return pushed(svbrdf_session_push_capture(get(), capture.get(), index, &report), report);
    }
    /// Judges a photo of a board, or a picture of the preview, without taking it in.
    Probe probe(const svbrdf_image& image, const svbrdf_frame_info* info = nullptr) const {
        return probed([&](svbrdf_probe* report) {
            return svbrdf_session_probe(get(), &image, info, report);
        });
    }
    /// Judges a picture of the preview and tells what to do: hold, move there, shoot now, or enough. Call it
    /// with every picture; `info->timestamp_ns` says when it was taken.
    Guidance guide(const svbrdf_image& image, const svbrdf_frame_info& info) {
        svbrdf_guidance report = make(svbrdf_guidance_init);
        Probe probe = probed([&](svbrdf_probe* found) {
            return svbrdf_session_guide(get(), &image, &info, found, &report);
        });
        return {report.action, report.message, report, std::move(probe)};
    }
    /// Begins guidance anew with other options. Also tells that the photo asked for was not taken.
    void begin_guide(const svbrdf_guide_options& options = make(svbrdf_guide_options_init)) {
        check(svbrdf_session_guide_begin(get(), &options));
    }
    /// Takes an accepted photo back, as if it had never come; later ones move up by one.
    void remove(std::uint32_t index) { check(svbrdf_session_remove_frame(get(), index)); }
    /// How the maps of the moment explain an accepted photo.
    svbrdf_frame_fit frame_fit(std::uint32_t index) const {
        svbrdf_frame_fit fit = make(svbrdf_frame_fit_init);
        check(svbrdf_session_frame_fit(get(), index, &fit));
        return fit;
    }
    /// Limits the work on each photo.
    void set_budget(const svbrdf_budget& budget) {
        check(svbrdf_session_set_budget(get(), &budget));
    }
    /// No limits any more.
    void clear_budget() { check(svbrdf_session_set_budget(get(), nullptr)); }
    /// The session as bytes for load().
    Buffer save() const {
        svbrdf_buffer* buffer = nullptr;
        check(svbrdf_session_save_state(get(), &buffer));
        return Buffer(buffer);
    }
    /// The same into a file; what stood there stays when that fails.
    void save(const std::string& path) const {
        check(svbrdf_session_save_state_to(get(), path.c_str()));
    }
    /// Blocks until the fit has settled on all photos so far.
    void wait() { check(svbrdf_session_wait(get(), -1)); }
    /// The same for a limited time: whether it has settled.
    bool wait_for(std::chrono::milliseconds limit) {
        const svbrdf_status status = svbrdf_session_wait(get(), limit.count() < 0 ? 0 : limit.count());
        if (status == SVBRDF_TIMEOUT) {
            return false;
        }
        check(status);
        return true;
    }
    svbrdf_progress progress() const {
        svbrdf_progress progress = make(svbrdf_progress_init);
        check(svbrdf_session_progress(get(), &progress));
        return progress;
    }
    /// The maps as they are now; none before the first accepted photo.
    std::optional<Maps> snapshot() const {
        svbrdf_maps* maps = nullptr;
        const svbrdf_status status = svbrdf_session_snapshot_maps(get(), &maps);
        if (status == SVBRDF_NO_MAPS) {
            return std::nullopt;
        }
        check(status);
        return Maps(maps);
    }
    /// As snapshot(), at 1 / 2^level of the size: for showing maps meanwhile.
    std::optional<Maps> snapshot_reduced(std::uint32_t level) const {
        svbrdf_maps* maps = nullptr;
        const svbrdf_status status = svbrdf_session_snapshot_reduced(get(), level, &maps);
        if (status == SVBRDF_NO_MAPS) {
            return std::nullopt;
        }
        check(status);
        return Maps(maps);
    }
    /// As snapshot(), with the standard deviations of the maps: waits for a step of the fit.
    std::optional<Maps> snapshot_confidence() const {
        svbrdf_maps* maps = nullptr;
        const svbrdf_status status = svbrdf_session_snapshot_confidence(get(), &maps);
        if (status == SVBRDF_NO_MAPS) {
            return std::nullopt;
        }
        check(status);
        return Maps(maps);
    }
    /// Flash position (mm, camera frame) and ambient share as found so far.
    std::pair<std::array<double, 3>, float> light() const {
        std::pair<std::array<double, 3>, float> light{};
        check(svbrdf_session_light(get(), light.first.data(), &light.second));
        return light;
    }
    /// Where the next photo tells most; nothing before the first one and for rectified photos.
    std::optional<svbrdf_next_view> next_view() const {
        svbrdf_next_view view = make(svbrdf_next_view_init);
        check(svbrdf_session_next_view(get(), &view));
        return view.known == 1 ? std::make_optional(view) : std::nullopt;
    }
    /// The camera as used, given or estimated; nothing before a photo tells and for rectified ones.
    std::optional<svbrdf_camera> camera() const {
        svbrdf_camera camera = make(svbrdf_camera_init);
        check(svbrdf_session_camera(get(), &camera, nullptr));
        return camera.width > 0 ? std::make_optional(camera) : std::nullopt;
    }
    /// The printed sheet and the sample's height above it; nothing for rectified photos.
    std::optional<svbrdf_paper> paper() const {
        svbrdf_paper paper = make(svbrdf_paper_init);
        check(svbrdf_session_paper(get(), &paper));
        return paper.known == 1 ? std::make_optional(paper) : std::nullopt;
    }
    /// Pose of an accepted photo of a board as known now.
    Pose pose(std::uint32_t index) const {
        Pose pose;
        check(svbrdf_session_pose(get(), index, pose.rotation.data(), pose.translation_mm.data(),
                                  &pose.reprojection_rms_px));
        return pose;
    }
    void export_to(const std::string& path) const {
        check(svbrdf_session_export(get(), path.c_str()));
    }
    void pause() { check(svbrdf_session_pause(get())); }
    void resume() { check(svbrdf_session_resume(get())); }
    void cancel() { check(svbrdf_session_cancel(get())); }
    svbrdf_session* get() const noexcept { return owner_.get(); }

private:
    /// A probe that a call fills in, with its corners.
    template <typename Call>
    static Probe probed(const Call& call) {
        svbrdf_probe report = make(svbrdf_probe_init);
        std::vector<std::array<float, 2>> corners(1024);
        report.corners_px = corners.front().data();
        report.corners_capacity = static_cast<std::uint32_t>(corners.size());
        check(call(&report));
        corners.resize(std::min<std::size_t>(report.corners_found, corners.size()));
        report.corners_px = nullptr;
        report.corners_capacity = 0;
        return {report.acceptable == 1, report.rejection, report.advice, report, std::move(corners)};
    }
    Session() = default;
    /// Makes the session; `options` are those that `create` uses.
    template <typename Create>
    void open(svbrdf_session_options& options, Callbacks&& callbacks, Create create) {
        if (callbacks.progress || callbacks.maps || callbacks.log) {
            callbacks_ = std::make_unique<Callbacks>(std::move(callbacks));
            options.user_data = callbacks_.get();
            options.on_progress = callbacks_->progress ? on_progress : nullptr;
            options.on_maps = callbacks_->maps ? on_maps : nullptr;
            options.on_log = callbacks_->log ? on_log : nullptr;
        }
        svbrdf_session* session = nullptr;
        check(create(&session));
        owner_ = detail::Owner<svbrdf_session, svbrdf_session_destroy>(session);
    }
    static Pushed pushed(svbrdf_status status, const svbrdf_frame_report& report) {
        if (status == SVBRDF_REJECTED) {
            return {false, report.rejection, report.advice, report};
        }
        check(status);
        return {true, SVBRDF_REJECTION_NONE, report.advice, report};
    }
    template <typename Call>
    static void guarded(Call call) noexcept {
        try {
            call();
        } catch (...) {
            // Exceptions must not run through C.
        }
    }
    static void on_progress(void* user, svbrdf_session* session, const svbrdf_progress* progress) {
        guarded([&] { static_cast<Callbacks*>(user)->progress(session, *progress); });
    }
    static void on_maps(void* user, svbrdf_session* session) {
        guarded([&] { static_cast<Callbacks*>(user)->maps(session); });
    }
    static void on_pushed(void* user, svbrdf_session*, svbrdf_status status,
                          const svbrdf_frame_report* report) {
        const std::unique_ptr<PushedCallback> done(static_cast<PushedCallback*>(user));
        guarded([&] {
            if (status == SVBRDF_OK || status == SVBRDF_REJECTED) {
                (*done)(status, pushed(status, *report));
            } else {
                (*done)(status, {false, SVBRDF_REJECTION_NONE, svbrdf_last_error_message(), *report});
            }
        });
    }
    static void on_log(void* user, svbrdf_log_level level, const char* message) {
        guarded([&] { static_cast<Callbacks*>(user)->log(level, message); });
    }

    // Destroyed in reverse: the session first.
    std::unique_ptr<Callbacks> callbacks_;
    detail::Owner<svbrdf_session, svbrdf_session_destroy> owner_;
};

}  // namespace svbrdf

#endif
