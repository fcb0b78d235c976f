// Part of svbrdf.hpp: reports of a session about photos and its fit.
#ifndef SVBRDF_RESULTS_HPP
#define SVBRDF_RESULTS_HPP

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core.hpp"
#include "enums.hpp"

namespace svbrdf {

/// The outcome of a photo.
struct Outcome {
    /// Whether it takes part in the fit.
    bool accepted;
    /// Why not; Rejection::none for an accepted photo.
    Rejection rejection;
    /// Text for the user: the reason of a rejection, or hints about an accepted photo; may be empty.
    std::string advice;
    /// Pose, hints and figures.
    svbrdf_photo_report report;
    /// Whether a hint was given.
    bool has(Hint hint) const noexcept { return (report.hints & to_c(hint)) != 0; }
    explicit operator bool() const noexcept { return accepted; }
};

/// Something to tell about an accepted photo.
struct PhotoHint {
    /// Number of the photo among the accepted ones, from 0.
    std::uint32_t index;
    /// Stable name for programs, such as "two_groups".
    std::string code;
    /// A sentence: the observation with its figure, and the remedy.
    std::string text;
};

/// Where the board lies in a photo.
struct Pose {
    /// From the board to the camera, row by row.
    std::array<double, 9> rotation{};
    /// Board origin in the camera frame, mm.
    std::array<double, 3> translation_mm{};
    /// Reprojection error of the board's corners, px.
    double reprojection_rms_px = 0.0;
};

/// The verdict on a photo that is not added.
struct Probe {
    /// Whether a photo like it would be accepted.
    bool acceptable;
    /// Why not; Rejection::none for an acceptable photo.
    Rejection rejection;
    /// Text for the user: the reason of a rejection, or hints; may be empty.
    std::string advice;
    /// Pose, view, blur, light and figures.
    svbrdf_probe report;
    /// Corners of the board that were found: x and y, px.
    std::vector<std::array<float, 2>> corners;
    /// Whether a hint was given.
    bool has(Hint hint) const noexcept { return (report.hints & to_c(hint)) != 0; }
    explicit operator bool() const noexcept { return acceptable; }
};

/// The next action, see SessionView::guide().
struct Guidance {
    Action action;
    /// For the user.
    std::string message;
    /// The target, and the gains of photos from here and from there.
    svbrdf_guidance report;
    /// The image that was judged.
    Probe probe;
};

/// State of a fit.
struct Progress {
    State state;
    /// The phase of the fit.
    Phase phase;
    /// Photos accepted so far.
    std::uint32_t photos;
    /// Whether the fit has finished on all photos so far.
    bool settled;
    /// Fraction of the work that is done, 0 to 1: on the photos announced, without on the latest one. See
    /// svbrdf_progress.
    float fraction;
    /// Mean error (log-L1 of renderings) before the fit of the latest photo, and now.
    float loss_before, loss;
    /// Estimated seconds left, where known.
    std::optional<float> seconds_left;
    /// Sets of maps published so far: when it has grown, there are newer maps.
    std::uint64_t maps_revision;

    explicit Progress(const svbrdf_progress& c)
        : state(State{c.state}), phase(Phase{c.phase}), photos(c.photos), settled(c.settled == 1),
          fraction(c.fraction), loss_before(c.loss_before), loss(c.loss),
          seconds_left(c.seconds_left < 0.0f ? std::nullopt : std::make_optional(c.seconds_left)),
          maps_revision(c.maps_revision) {}
};

}  // namespace svbrdf

#endif
