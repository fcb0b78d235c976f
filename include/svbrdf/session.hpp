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
#include "enums.hpp"
#include "maps.hpp"
#include "results.hpp"

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
    std::uint32_t photos() const {
        std::uint32_t count = 0;
        check(svbrdf_capture_photos(get(), &count));
        return count;
    }
    svbrdf_capture* get() const noexcept { return owner_.get(); }

private:
    detail::Owner<svbrdf_capture, svbrdf_capture_destroy> owner_;
};

class SessionView;

/// Called with the outcome of a photo that was added without waiting.
using OutcomeCallback = std::function<void(SessionView, StatusCode, const Outcome&)>;

/// A session that somebody else owns, as callbacks receive it. Copies are cheap. Once the session has
/// been destroyed, calls throw an Error with StatusCode::invalid_handle.
class SessionView {
public:
    explicit SessionView(svbrdf_session* session) noexcept : handle_(session) {}

    /// Takes a photo of a board in.
    Outcome add_photo(const svbrdf_image& image, const svbrdf_photo_info* info = nullptr) {
        svbrdf_photo_report report = make(svbrdf_photo_report_init);
        return outcome(svbrdf_session_add_photo(get(), &image, info, &report), report);
    }
    /// As add_photo(), without waiting: `done` is called exactly once on a thread of the session, with
    /// StatusCode::ok, StatusCode::rejected, or a fault, whose message is the advice. It may destroy
    /// the session. Exceptions that it throws are dropped. When this throws, `done` is not called.
    void add_photo_async(const svbrdf_image& image, OutcomeCallback done,
                    const svbrdf_photo_info* info = nullptr) {
        auto held = std::make_unique<OutcomeCallback>(std::move(done));
        check(svbrdf_session_add_photo_async(get(), &image, info, on_outcome, held.get()));
        // on_outcome() owns it.
        static_cast<void>(held.release());
    }
    /// Takes a photo from the top in; positions of camera and light in the board frame, mm.
    Outcome add_rectified_photo(const svbrdf_image& image, const std::array<float, 3>& camera_mm,
                          const std::array<float, 3>& light_mm,
                          const svbrdf_photo_info* info = nullptr) {
        svbrdf_photo_report report = make(svbrdf_photo_report_init);
        return outcome(svbrdf_session_add_rectified_photo(get(), &image, info, camera_mm.data(),
                                                    light_mm.data(), &report),
                      report);
    }
    /// Reads a photo of a capture and takes it in.
    Outcome add_photo(const Capture& capture, std::uint32_t index) {
        svbrdf_photo_report report = make(svbrdf_photo_report_init);
        return outcome(svbrdf_session_add_capture_photo(get(), capture.get(), index, &report), report);
    }
    /// Takes in a photo of a board that is a file in memory, see svbrdf_session_add_photo_file(). `info`
    /// gets the metadata of the file.
    Outcome add_photo_file(Span<const std::uint8_t> file,
                        const svbrdf_file_options* options = nullptr,
                        svbrdf_file_info* info = nullptr) {
        svbrdf_photo_report report = make(svbrdf_photo_report_init);
        return outcome(svbrdf_session_add_photo_file(get(), file.data(), file.size(), options, info,
                                                  &report),
                      report);
    }
    /// Judges a photo of a board, or an image of the preview, without taking it in.
    Probe probe(const svbrdf_image& image, const svbrdf_photo_info* info = nullptr) const {
        return probed([&](svbrdf_probe* report) {
            return svbrdf_session_probe(get(), &image, info, report);
        });
    }
    /// Judges an image of the preview and returns the next action: adjust, hold, move, shoot, or enough. Call it
    /// with every image; `info.timestamp_ns` is its time.
    Guidance guide(const svbrdf_image& image, const svbrdf_photo_info& info) {
        svbrdf_guidance report = make(svbrdf_guidance_init);
        Probe probe = probed([&](svbrdf_probe* found) {
            return svbrdf_session_guide(get(), &image, &info, found, &report);
        });
        return {Action{report.action}, report.message, report, std::move(probe)};
    }
    /// Starts guidance again, with other options. Also says that a requested photo was not taken.
    void begin_guide(const svbrdf_guide_options& options = make(svbrdf_guide_options_init)) {
        check(svbrdf_session_guide_begin(get(), &options));
    }
    /// Takes an accepted photo back, as if it had never come; later ones move up by one.
    void remove_photo(std::uint32_t index) { check(svbrdf_session_remove_photo(get(), index)); }
    /// How well the current maps explain an accepted photo.
    svbrdf_photo_fit photo_fit(std::uint32_t index) const {
        svbrdf_photo_fit fit = make(svbrdf_photo_fit_init);
        check(svbrdf_session_photo_fit(get(), index, &fit));
        return fit;
    }
    /// Hints about each accepted photo from all present knowledge; meaningful once the fit has settled.
    std::vector<PhotoHint> hints() const {
        std::vector<PhotoHint> all;
        check(svbrdf_session_hints(
            get(),
            [](void* to, std::uint32_t index, const char* code, const char* text) {
                static_cast<std::vector<PhotoHint>*>(to)->push_back({index, code, text});
            },
            &all));
        return all;
    }
    /// Limits the work on each photo.
    void set_budget(const svbrdf_budget& budget) {
        check(svbrdf_session_set_budget(get(), &budget));
    }
    /// Lifts the limits.
    void clear_budget() { check(svbrdf_session_set_budget(get(), nullptr)); }
    /// The session as bytes for Session::load().
    Buffer save() const {
        svbrdf_buffer* buffer = nullptr;
        check(svbrdf_session_save_state(get(), &buffer));
        return Buffer(buffer);
    }
    /// The same into a file; an older file stays when this fails.
    void save(const std::string& path) const {
        check(svbrdf_session_save_state_to(get(), path.c_str()));
    }
    /// Blocks until the fit has settled on all photos so far.
    void wait() { check(svbrdf_session_wait(get(), -1)); }
    /// The same for a limited time: whether the fit has settled.
    bool wait_for(std::chrono::milliseconds limit) {
        const svbrdf_status status = svbrdf_session_wait(get(), limit.count() < 0 ? 0 : limit.count());
        if (status == SVBRDF_TIMEOUT) {
            return false;
        }
        check(status);
        return true;
    }
    /// Announces that so many photos are still to come: Progress::fraction is then that of the work on all
    /// of them together, and never falls before they have come. Without it, it is that of each photo.
    void announce(std::uint32_t photos) { check(svbrdf_session_announce(get(), photos)); }
    Progress progress() const {
        svbrdf_progress progress = make(svbrdf_progress_init);
        check(svbrdf_session_progress(get(), &progress));
        return Progress(progress);
    }
    /// The current maps; none before the first accepted photo.
    std::optional<Maps> snapshot() const { return taken(svbrdf_session_snapshot_maps); }
    /// As snapshot(), with the standard deviations of the maps: waits for a step of the fit.
    std::optional<Maps> snapshot_with_uncertainty() const {
        return taken(svbrdf_session_snapshot_with_uncertainty);
    }
    /// Position of the flash (mm, camera frame), and ambient light as a share of the flash's.
    std::pair<std::array<double, 3>, float> light() const {
        std::pair<std::array<double, 3>, float> light{};
        check(svbrdf_session_light(get(), light.first.data(), &light.second));
        return light;
    }
    /// The view that would teach the most; none before the first photo and for rectified photos.
    std::optional<svbrdf_next_view> next_view() const {
        svbrdf_next_view view = make(svbrdf_next_view_init);
        check(svbrdf_session_next_view(get(), &view));
        return view.known == 1 ? std::make_optional(view) : std::nullopt;
    }
    /// The camera, given or estimated; none while it is unknown and for rectified photos.
    std::optional<svbrdf_camera> camera() const {
        svbrdf_camera camera = make(svbrdf_camera_init);
        check(svbrdf_session_camera(get(), &camera, nullptr));
        return camera.width > 0 ? std::make_optional(camera) : std::nullopt;
    }
    /// The printed sheet and the sample's height above it; none for rectified photos.
    std::optional<svbrdf_paper> paper() const {
        svbrdf_paper paper = make(svbrdf_paper_init);
        check(svbrdf_session_paper(get(), &paper));
        return paper.known == 1 ? std::make_optional(paper) : std::nullopt;
    }
    /// Current estimate of the pose of an accepted photo of a board.
    Pose pose(std::uint32_t index) const {
        Pose pose;
        check(svbrdf_session_pose(get(), index, pose.rotation.data(), pose.translation_mm.data(),
                                  &pose.reprojection_rms_px));
        return pose;
    }
    /// Holds the fit; photos are still taken in.
    void pause() { check(svbrdf_session_pause(get())); }
    void resume() { check(svbrdf_session_resume(get())); }
    /// Ends the fit for good; the maps stay available.
    void cancel() { check(svbrdf_session_cancel(get())); }
    svbrdf_session* get() const noexcept { return handle_; }

protected:
    template <typename Call>
    static void guarded(Call call) noexcept {
        try {
            call();
        } catch (...) {
            // Exceptions must not pass through C.
        }
    }

    svbrdf_session* handle_;

private:
    // A session may end inside a callback of one of these calls: none touches *this afterwards.
    static Outcome outcome(svbrdf_status status, const svbrdf_photo_report& report) {
        if (status == SVBRDF_REJECTED) {
            return {false, Rejection{report.rejection}, report.advice, report};
        }
        check(status);
        return {true, Rejection::none, report.advice, report};
    }
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
        return {report.acceptable == 1, Rejection{report.rejection}, report.advice, report,
                std::move(corners)};
    }
    std::optional<Maps> taken(svbrdf_status (*take)(const svbrdf_session*, svbrdf_maps**)) const {
        svbrdf_maps* maps = nullptr;
        const svbrdf_status status = take(get(), &maps);
        if (status == SVBRDF_NO_MAPS) {
            return std::nullopt;
        }
        check(status);
        return Maps(maps);
    }
    static void on_outcome(void* user, svbrdf_session* session, svbrdf_status status,
                          const svbrdf_photo_report* report) {
        const std::unique_ptr<OutcomeCallback> done(static_cast<OutcomeCallback*>(user));
        guarded([&] {
            const SessionView view(session);
            if (status == SVBRDF_OK || status == SVBRDF_REJECTED) {
                (*done)(view, StatusCode{status}, outcome(status, *report));
            } else {
                (*done)(view, StatusCode{status},
                        {false, Rejection::none, svbrdf_last_error_message(), *report});
            }
        });
    }
};

/// Functions a session calls on threads of its own (log also on those inside a call). They may call
/// everything, and destroy the session. Exceptions that they throw are dropped.
struct Callbacks {
    std::function<void(SessionView, const Progress&)> progress;
    std::function<void(SessionView)> maps;
    std::function<void(LogLevel, const char*)> log;
};

/// A capture in progress. It may be destroyed at any time, also inside its own callbacks; see
/// svbrdf_session_destroy().
class Session : public SessionView {
public:
    /// `callbacks` take the place of those of `options`.
    explicit Session(svbrdf_session_options options, Callbacks callbacks = {})
        : SessionView(nullptr) {
        open(options, std::move(callbacks), [&](svbrdf_session** session) {
            return svbrdf_session_create(&options, session);
        });
    }
    /// With scene, sample, board, camera, flash and falloff of a capture.
    Session(const Capture& capture, svbrdf_session_options options, Callbacks callbacks = {})
        : Session((options.capture = capture.get(), options), std::move(callbacks)) {}
    /// Continues a saved session; see svbrdf_session_load_state() for the fields of `options` that apply.
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
    Session(Session&& other) noexcept
        : SessionView(std::exchange(other.handle_, nullptr)), state_(std::move(other.state_)) {}
    Session& operator=(Session&& other) noexcept {
        if (this != &other) {
            // The session ends before the functions that it calls.
            svbrdf_session_destroy(handle_);
            handle_ = std::exchange(other.handle_, nullptr);
            state_ = std::move(other.state_);
        }
        return *this;
    }
    // The handle is not cleared: calls on other threads may read it until those that use it have ended.
    ~Session() { svbrdf_session_destroy(handle_); }

private:
    /// The functions, kept alive by each of their calls: one of them may destroy the session.
    struct State : std::enable_shared_from_this<State> {
        explicit State(Callbacks&& given) : callbacks(std::move(given)) {}
        Callbacks callbacks;
    };

    Session() noexcept : SessionView(nullptr) {}
    /// Makes the session; `options` are those that `create` uses.
    template <typename Create>
    void open(svbrdf_session_options& options, Callbacks&& callbacks, Create create) {
        if (callbacks.progress || callbacks.maps || callbacks.log) {
            state_ = std::make_shared<State>(std::move(callbacks));
            options.user_data = state_.get();
            options.on_progress = state_->callbacks.progress ? on_progress : nullptr;
            options.on_maps = state_->callbacks.maps ? on_maps : nullptr;
            options.on_log = state_->callbacks.log ? on_log : nullptr;
        }
        check(create(&handle_));
    }
    static std::shared_ptr<State> state_of(void* user) {
        return static_cast<State*>(user)->shared_from_this();
    }
    static void on_progress(void* user, svbrdf_session* session, const svbrdf_progress* progress) {
        const auto state = state_of(user);
        guarded([&] { state->callbacks.progress(SessionView(session), Progress(*progress)); });
    }
    static void on_maps(void* user, svbrdf_session* session) {
        const auto state = state_of(user);
        guarded([&] { state->callbacks.maps(SessionView(session)); });
    }
    static void on_log(void* user, svbrdf_log_level level, const char* message) {
        const auto state = state_of(user);
        guarded([&] { state->callbacks.log(LogLevel{level}, message); });
    }

    std::shared_ptr<State> state_;
};

}  // namespace svbrdf

#endif
