import SVBRDF

/// Why a photo cannot be used. Show `advice` for those that are not known here.
public struct Rejection: RawRepresentable, Hashable, Sendable {
    public let rawValue: UInt32

    public init(rawValue: UInt32) {
        self.rawValue = rawValue
    }

    public static let other = Self(rawValue: UInt32(SVBRDF_REJECTION_OTHER))
    public static let wrongSize = Self(rawValue: UInt32(SVBRDF_REJECTION_WRONG_SIZE))
    public static let boardNotFound = Self(rawValue: UInt32(SVBRDF_REJECTION_BOARD_NOT_FOUND))
    public static let tooFewCorners = Self(rawValue: UInt32(SVBRDF_REJECTION_TOO_FEW_CORNERS))
    public static let poseUncertain = Self(rawValue: UInt32(SVBRDF_REJECTION_POSE_UNCERTAIN))
    public static let blurred = Self(rawValue: UInt32(SVBRDF_REJECTION_BLURRED))
    public static let tooDark = Self(rawValue: UInt32(SVBRDF_REJECTION_TOO_DARK))
    public static let clipped = Self(rawValue: UInt32(SVBRDF_REJECTION_CLIPPED))
    public static let tooGrazing = Self(rawValue: UInt32(SVBRDF_REJECTION_TOO_GRAZING))
    public static let sampleOutside = Self(rawValue: UInt32(SVBRDF_REJECTION_SAMPLE_OUTSIDE))
    public static let lightNotVisible = Self(rawValue: UInt32(SVBRDF_REJECTION_LIGHT_NOT_VISIBLE))
    public static let notFinite = Self(rawValue: UInt32(SVBRDF_REJECTION_NOT_FINITE))
    public static let placementAmbiguous = Self(
        rawValue: UInt32(SVBRDF_REJECTION_PLACEMENT_AMBIGUOUS))
    public static let boardDiffers = Self(rawValue: UInt32(SVBRDF_REJECTION_BOARD_DIFFERS))
    public static let otherCamera = Self(rawValue: UInt32(SVBRDF_REJECTION_OTHER_CAMERA))
    public static let squaresTooSmall = Self(rawValue: UInt32(SVBRDF_REJECTION_SQUARES_TOO_SMALL))
    public static let flickers = Self(rawValue: UInt32(SVBRDF_REJECTION_FLICKERS))
    public static let edited = Self(rawValue: UInt32(SVBRDF_REJECTION_EDITED))
}

/// Hints about an accepted photo.
public struct Hints: OptionSet, Hashable, Sendable {
    public let rawValue: UInt32

    public init(rawValue: UInt32) {
        self.rawValue = rawValue
    }

    public static let other = Self(rawValue: UInt32(SVBRDF_HINT_OTHER))
    /// Nearly the view of an earlier photo: move the camera.
    public static let nothingNew = Self(rawValue: UInt32(SVBRDF_HINT_NOTHING_NEW))
    /// The pixel values are not linear.
    public static let notLinear = Self(rawValue: UInt32(SVBRDF_HINT_NOT_LINEAR))
}

/// Something to tell about an accepted photo.
public struct PhotoHint: Hashable, Sendable {
    /// Number of the photo among the accepted ones, from 0.
    public let index: Int
    /// Stable name for programs, such as "two_groups".
    public let code: String
    /// An English sentence: the observation with its figure, and the remedy.
    public let text: String
}

/// Where the board lies as the camera sees it: x_camera = rotation * x_board + translation.
public struct Pose: Hashable, Sendable {
    /// Rows, one after the other.
    public let rotation: [Double]
    public let translationMM: [Double]
    public let reprojectionRMSPixels: Double

    init?(_ known: UInt32, _ rotation: [Double], _ translation: [Double], _ rms: Double) {
        guard known == 1 else { return nil }
        (self.rotation, translationMM, reprojectionRMSPixels) = (rotation, translation, rms)
    }
}

/// The quantity of a rejection's value, and its unit.
public struct Measure: RawRepresentable, Hashable, Sendable {
    public let rawValue: UInt32

    public init(rawValue: UInt32) {
        self.rawValue = rawValue
    }

    /// Nothing was measured.
    public static let none = Self(rawValue: UInt32(SVBRDF_MEASURE_NONE))
    /// Corners found; the limit is the number needed.
    public static let corners = Self(rawValue: UInt32(SVBRDF_MEASURE_CORNERS))
    public static let reprojectionPixels = Self(rawValue: UInt32(SVBRDF_MEASURE_REPROJECTION_PX))
    public static let blurPixels = Self(rawValue: UInt32(SVBRDF_MEASURE_BLUR_PX))
    /// Level of the white squares, 1 is full scale.
    public static let whiteLevel = Self(rawValue: UInt32(SVBRDF_MEASURE_WHITE_LEVEL))
    /// Share of pixels that are clipped, 0 to 1.
    public static let clippedShare = Self(rawValue: UInt32(SVBRDF_MEASURE_CLIPPED_SHARE))
    /// Off the vertical; the limit is the largest angle that is allowed.
    public static let tiltDegrees = Self(rawValue: UInt32(SVBRDF_MEASURE_TILT_DEG))
    /// Share of the sample that is seen, 0 to 1.
    public static let sampleShare = Self(rawValue: UInt32(SVBRDF_MEASURE_SAMPLE_SHARE))
    /// Focal length over that of the scanner's camera.
    public static let focalRatio = Self(rawValue: UInt32(SVBRDF_MEASURE_FOCAL_RATIO))
    /// Side of the board's squares; the limit is the side needed.
    public static let squarePixels = Self(rawValue: UInt32(SVBRDF_MEASURE_SQUARE_PX))
    /// Relative amplitude of the stripes.
    public static let stripes = Self(rawValue: UInt32(SVBRDF_MEASURE_STRIPES))
    /// Value of the black squares over that of white; the limit is the ratio as printed.
    public static let overWhite = Self(rawValue: UInt32(SVBRDF_MEASURE_OVER_WHITE))
}

/// The value that led to a rejection.
public struct Figure: Hashable, Sendable {
    public let measure: Measure
    public let value: Float
    /// The value needed or allowed; 0: there is no single one.
    public let limit: Float
}

/// The outcome of a photo.
public enum Outcome: Hashable, Sendable {
    case accepted(index: Int, hints: Hints, pose: Pose?, advice: String)
    /// The scan is unchanged. `advice` is for the user; `figure` has the values of the reason.
    case rejected(Rejection, figure: Figure, advice: String)

    init(_ report: svbrdf_photo_report) {
        let advice = text(report.advice)
        guard report.accepted == 1 else {
            let reason = Rejection(rawValue: report.rejection)
            let figure = Figure(
                measure: Measure(rawValue: report.measure), value: report.measured, limit: report.limit
            )
            self = .rejected(reason, figure: figure, advice: advice)
            return
        }
        let pose = Pose(
            report.has_pose, numbers(report.rotation, as: Double.self),
            numbers(report.translation_mm, as: Double.self), report.reprojection_rms_px
        )
        let hints = Hints(rawValue: report.hints)
        self = .accepted(index: Int(report.index), hints: hints, pose: pose, advice: advice)
    }
}

/// The verdict on a photo or an image of the preview.
public struct Probe: Hashable, Sendable {
    public let acceptable: Bool
    /// Why it would be rejected.
    public let rejection: Rejection?
    public let hints: Hints
    public let advice: String
    public let cornersFound: Int
    /// Corners that the whole board has.
    public let cornersExpected: Int
    public let pose: Pose?
    public let distanceMM: Float
    /// Degrees off the vertical.
    public let tiltDegrees: Float
    /// Side that the camera looks from, degrees counter-clockwise from the board's right.
    public let azimuthDegrees: Float
    /// Degrees off the view asked for; nil: none is asked for yet.
    public let offNextDegrees: Float?
    /// Share of the sample inside the image.
    public let sampleSeen: Float
    /// Corners of the sample in the image, px: x, y of each.
    public let samplePixels: [Float]
    public let blurPixels: Float

    init(_ probe: svbrdf_probe) {
        acceptable = probe.acceptable == 1
        let none = svbrdf_rejection(SVBRDF_REJECTION_NONE)
        rejection = probe.rejection == none ? nil : Rejection(rawValue: probe.rejection)
        hints = Hints(rawValue: probe.hints)
        advice = text(probe.advice)
        (cornersFound, cornersExpected) = (Int(probe.corners_found), Int(probe.corners_expected))
        pose = Pose(
            probe.has_pose, numbers(probe.rotation, as: Double.self),
            numbers(probe.translation_mm, as: Double.self), probe.reprojection_rms_px
        )
        (distanceMM, tiltDegrees) = (probe.distance_mm, probe.tilt_deg)
        azimuthDegrees = probe.azimuth_deg
        offNextDegrees = probe.off_next_deg < 0 ? nil : probe.off_next_deg
        sampleSeen = probe.sample_seen
        samplePixels = numbers(probe.sample_px, as: Float.self)
        blurPixels = probe.blur_px
    }
}

/// The next action, see `MaterialScanner.guide`.
public struct Guidance: Hashable, Sendable {
    public enum Action: Hashable, Sendable {
        /// Correct the fault that the probe's `rejection` names: a photo would be rejected.
        case adjust
        /// Keep the camera where it is: until it is steady, or a photo has been taken in.
        case hold
        /// Go to the target.
        case move
        /// Nothing: take the photo now, and add it.
        case shoot
        /// Nothing more: a further photo would tell little.
        case enough
    }

    /// A place to take a photo from, as seen from where the camera is.
    public struct Target: Hashable, Sendable {
        /// Degrees off the top.
        public let tiltDegrees: Float
        /// Side, degrees counter-clockwise from the board's right.
        public let azimuthDegrees: Float
        /// From the camera to there, camera frame, mm: x right, y down, z forward. An arrow along x and y in
        /// the image shows the way.
        public let offsetMM: SIMD3<Float>
        /// Degrees between the view and the target, seen from the sample.
        public let degrees: Float
    }

    public let action: Action
    /// For the user, in English.
    public let message: String
    /// The image that was judged.
    public let probe: Probe
    /// Accepted photos so far.
    public let photos: Int
    /// nil where the camera's place or the target is not known.
    public let target: Target?
    /// Share of the expected squared error of renderings that a photo from here would take away, 0 to 1; nil:
    /// not known.
    public let gain: Float?
    /// The same of the view that tells most.
    public let bestGain: Float?

    init(_ guidance: svbrdf_guidance, _ probe: Probe) {
        switch guidance.action {
        case svbrdf_action(SVBRDF_ACTION_ADJUST): action = .adjust
        case svbrdf_action(SVBRDF_ACTION_MOVE): action = .move
        case svbrdf_action(SVBRDF_ACTION_SHOOT): action = .shoot
        case svbrdf_action(SVBRDF_ACTION_ENOUGH): action = .enough
        default: action = .hold
        }
        message = text(guidance.message)
        (self.probe, photos) = (probe, Int(guidance.photos))
        let offset = guidance.offset_mm
        target = guidance.has_target != 1 ? nil : Target(
            tiltDegrees: guidance.target_tilt_deg, azimuthDegrees: guidance.target_azimuth_deg,
            offsetMM: SIMD3(offset.0, offset.1, offset.2), degrees: guidance.degrees
        )
        gain = guidance.gain < 0 ? nil : guidance.gain
        bestGain = guidance.best_gain < 0 ? nil : guidance.best_gain
    }
}

/// From where the next photo tells most.
public struct NextView: Hashable, Sendable {
    public let tiltDegrees: Float
    public let azimuthDegrees: Float
    /// Towards the camera, board frame: X right, Y up, Z out of the sample.
    public let direction: SIMD3<Float>

    init(_ view: svbrdf_next_view) {
        (tiltDegrees, azimuthDegrees) = (view.tilt_deg, view.azimuth_deg)
        direction = SIMD3(view.direction.0, view.direction.1, view.direction.2)
    }
}

/// State of the fit.
public struct Progress: Hashable, Sendable {
    public enum State: Hashable, Sendable {
        case ready, fitting, paused, cancelled, failed
    }

    public let state: State
    public let photos: Int
    public let settled: Bool
    /// Fraction of the work that is done, 0 to 1: on the photos of `MaterialScanner.announce`, else on the latest.
    public let fraction: Float
    /// The phase of the fit, an English word; empty when it has nothing to do.
    public let phase: String
    /// Rises with every new set of maps.
    public let mapsRevision: UInt64

    init(_ progress: svbrdf_progress) {
        state = switch progress.state {
        case svbrdf_state(SVBRDF_STATE_READY): .ready
        case svbrdf_state(SVBRDF_STATE_PAUSED): .paused
        case svbrdf_state(SVBRDF_STATE_CANCELLED): .cancelled
        case svbrdf_state(SVBRDF_STATE_FAILED): .failed
        default: .fitting
        }
        (photos, settled) = (Int(progress.photos), progress.settled == 1)
        (fraction, mapsRevision) = (progress.fraction, progress.maps_revision)
        let none = progress.phase == svbrdf_phase(SVBRDF_PHASE_NONE)
        phase = none ? "" : String(cString: svbrdf_phase_name(progress.phase))
    }
}

/// How far each map may be off: a standard deviation.
public struct Uncertainty: Hashable, Sendable {
    public let normal: Float
    public let diffuse: Float
    public let specular: Float
    public let roughness: Float

    init(_ uncertainty: svbrdf_uncertainty) {
        (normal, diffuse) = (uncertainty.normal, uncertainty.diffuse)
        (specular, roughness) = (uncertainty.specular, uncertainty.roughness)
    }
}
