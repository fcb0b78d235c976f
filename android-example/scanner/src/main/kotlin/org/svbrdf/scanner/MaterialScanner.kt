package org.svbrdf.scanner

import java.io.File

/**
 * Normal, diffuse, specular and roughness maps of a flat sample from photos of it inside a printed
 * board, one photo at a time.
 *
 * Every method may be called from any thread at any time. [addPhoto] takes a fraction of a second and
 * [await] as long as the fit: call them off the main thread. Wrong arguments throw an
 * [IllegalArgumentException], a closed scanner an [IllegalStateException], files an
 * [java.io.IOException], and all other faults a [ScannerException]. A photo that cannot be used is no
 * exception: see [Outcome.Rejected].
 */
class MaterialScanner private constructor(
    options: ScanOptions,
    internal val listener: Listener?,
    saved: File?,
) : AutoCloseable {

    /** A new scan. */
    @JvmOverloads
    constructor(options: ScanOptions = ScanOptions(), listener: Listener? = null) :
        this(options, listener, null)

    /**
     * Callbacks of a scanner. [onProgress] and [onMaps] come on one thread of the scanner, one at a
     * time: post to your own. They may call every method of the scanner, also [close], but should
     * not [await]. Their exceptions go to the thread's handler of uncaught exceptions, unless the
     * scanner was closed meanwhile.
     */
    interface Listener {
        /** The fit has moved on; changes that come too fast are left out. */
        fun onProgress(scanner: MaterialScanner, progress: Progress) {}

        /** Newer maps can be taken with [snapshot]. */
        fun onMaps(scanner: MaterialScanner) {}

        /** A line for the log, on the thread it happens on; those of the fit come on the thread of the others. */
        fun onLog(level: LogLevel, line: String) {}
    }

    private val creation = Any()
    private val handle: Handle
    private var complete = false

    init {
        val id = if (listener == null) 0 else Native.register(this)
        try {
            synchronized(creation) {
                val session = options.create(this, id, saved)
                handle = Handle(this, session) {
                    Native.unregister(id)
                    Native.sessionDestroy(it)
                }
                complete = true
            }
        } catch (thrown: Throwable) {
            Native.unregister(id)
            throw thrown
        }
    }

    internal val closed: Boolean get() = created() && handle.now == 0L

    /** For callbacks: a restored scanner's may come before its constructor is through. */
    internal fun created(): Boolean = synchronized(creation) { complete }

    /**
     * Takes a photo of the board in; it is not needed after the call. When accepted, maps that know
     * of it can be taken at once; the fit goes on in the background.
     */
    @JvmOverloads
    fun addPhoto(photo: Photo, info: PhotoInfo = PhotoInfo()): Outcome =
        photo.addTo(this, handle.now, info, null, null)

    /**
     * As [addPhoto] with a photo that is a file. One that is damaged, or of a format that is not read, is an
     * [IllegalArgumentException] that names it.
     */
    fun addPhoto(file: PhotoFile): PhotoFileOutcome = file.addTo(this, handle.now)

    /** Called with the outcome of a photo; exactly one of the two is null. */
    fun interface OutcomeCallback {
        fun onOutcome(outcome: Outcome?, fault: Throwable?)
    }

    /**
     * As [addPhoto], without waiting: returns once the planes are copied. Photos are taken in one after the
     * other; [done] is called exactly once, on a thread of the scanner, also when it is cancelled or
     * closed meanwhile (a [ScannerException] of [Fault.CANCELLED]), but not when this throws. With three
     * photos on their way it throws one of [Fault.BUSY].
     */
    @JvmOverloads
    fun addPhotoAsync(photo: Photo, info: PhotoInfo = PhotoInfo(), done: OutcomeCallback) =
        photo.addToAsync(this, handle.now, info, done)

    /**
     * Takes a photo in that shows the sample's rectangle from the top, any size, with the positions
     * of camera and light: mm, origin at the sample's centre, X right, Y up, Z towards the camera.
     * For [ScanOptions.rectified].
     */
    @JvmOverloads
    fun addRectifiedPhoto(
        photo: Photo,
        cameraMm: FloatArray,
        lightMm: FloatArray,
        info: PhotoInfo = PhotoInfo(),
    ): Outcome = photo.addTo(this, handle.now, info, cameraMm, lightMm)

    /**
     * Judges a photo of the board, or an image of the preview of any size, without taking it in:
     * nothing of the scan changes. Waits for nothing; some hundredths of a second. With [Flash.OFF]
     * the light is not judged. [PhotoInfo.ambient] is ignored.
     */
    @JvmOverloads
    fun probe(photo: Photo, info: PhotoInfo = PhotoInfo()): Probe =
        photo.probe(this, handle.now, info)

    /**
     * Judges an image of the camera's preview as [probe] does and returns the next action: hold, move there, shoot
     * now, or enough. Call it with every image; [PhotoInfo.timestampNs] says when it was taken. After
     * [Action.SHOOT] it asks to hold until the photo has been added. Waits neither for the fit nor for a push.
     */
    @JvmOverloads
    fun guide(preview: Photo, info: PhotoInfo = PhotoInfo()): Guidance =
        preview.guide(this, handle.now, info)

    /**
     * Restarts guidance with other options. Also reports that the photo asked for was not taken, or was
     * rejected.
     */
    @JvmOverloads
    fun beginGuide(options: GuideOptions = GuideOptions()) = Native.sessionGuideBegin(
        this, handle.now,
        options.run {
            floatArrayOf(
                worth, steady, steadySeconds, enough, least.toFloat(), most.toFloat(), firstTiltDeg,
                shotSeconds,
            )
        },
    )

    /**
     * Takes an accepted photo back: the scan is as if it had never come. Later ones move up by one,
     * and the fit begins anew. Takes as long as a few photos take to be added.
     */
    fun removePhoto(index: Int) = Native.sessionRemovePhoto(this, handle.now, index)

    /** How the maps of the moment explain an accepted photo; meaningful once the fit has settled. */
    fun photoFit(index: Int): PhotoFit {
        val v = DoubleArray(3)
        Native.sessionPhotoFit(this, handle.now, index, v)
        return PhotoFit(v[0].toFloat(), v[1].toFloat(), v[2] == 1.0)
    }

    /**
     * Hints about the accepted photos from all present knowledge. Hints given when a photo was added may no longer
     * hold, and others may. Meaningful once the fit has settled.
     */
    fun hints(): List<PhotoHint> =
        Native.sessionHints(this, handle.now).toString(Charsets.UTF_8).split('\u0000')
            .dropLast(1).chunked(3) { (index, code, text) -> PhotoHint(index.toInt(), code, text) }

    /** Blocks until the fit has settled on all photos so far; false when the time is over first. */
    @JvmOverloads
    fun await(limitMillis: Long = -1): Boolean = Native.sessionWait(this, handle.now, limitMillis)

    /**
     * Announces that so many photos are still to come: [Progress.fraction] is then that of the work on all of
     * them together, and never falls before they have come. Each photo added takes one of them away, whether the photo
     * is accepted or rejected. If fewer or more come after all, say so by another call. Without it, in a live
     * capture, the fraction is that of each photo.
     */
    fun announce(photos: Int) {
        require(photos >= 0) { "photos: $photos given; at least 0 expected" }
        Native.sessionAnnounce(this, handle.now, photos)
    }

    /** State of the fit. */
    val progress: Progress
        get() {
            val values = DoubleArray(Progress.SIZE)
            Native.sessionProgress(this, handle.now, values)
            return Progress.of(values)
        }

    /** The light as found so far. */
    val light: Light
        get() {
            val values = DoubleArray(4)
            Native.sessionLight(this, handle.now, values)
            return Light(values.copyOf(3), values[3].toFloat())
        }

    /** The most informative next view; null before the first one and for photos from the top. */
    val nextView: NextView?
        get() {
            val v = DoubleArray(NextView.SIZE)
            Native.sessionNextView(this, handle.now, v)
            return NextView.of(v)
        }

    /** The camera as used; null before a photo determines it, and for photos from the top. */
    val camera: UsedCamera?
        get() {
            val v = DoubleArray(UsedCamera.SIZE)
            Native.sessionCamera(this, handle.now, v)
            return UsedCamera.of(v)
        }

    /** The printed sheet and the sample's height above it; null for photos from the top. */
    val paper: Paper?
        get() {
            val v = DoubleArray(Paper.SIZE)
            Native.sessionPaper(this, handle.now, v)
            return Paper.of(v)
        }

    /**
     * Where the board lay in an accepted photo, as known now: with an estimated camera later photos
     * better the poses of earlier ones.
     */
    fun pose(index: Int): Pose {
        val v = DoubleArray(13)
        Native.sessionPose(this, handle.now, index, v)
        return Pose(v.copyOf(9), v.copyOfRange(9, 12), v[12])
    }

    /** The maps as they are now; null before the first accepted photo. */
    fun snapshot(): MaterialMaps? {
        val maps = Native.sessionSnapshot(this, handle.now)
        return if (maps == 0L) null else MaterialMaps(maps)
    }

    /** As [snapshot], at 1 / 2^[level] of the size: for showing maps meanwhile. */
    fun snapshotReduced(level: Int): MaterialMaps? {
        val maps = Native.sessionSnapshotReduced(this, handle.now, level)
        return if (maps == 0L) null else MaterialMaps(maps)
    }

    /**
     * As [snapshot], with how far the maps may be off: see [MaterialMaps.uncertainty]. Computed when asked
     * for, and meaningful once the fit has settled; waits for a step of the fit.
     */
    fun snapshotWithUncertainty(): MaterialMaps? {
        val maps = Native.sessionSnapshotWithUncertainty(this, handle.now)
        return if (maps == 0L) null else MaterialMaps(maps)
    }

    /** Writes the maps as they are now into a folder, see [MaterialMaps.export]. */
    fun export(folder: File) {
        val maps = checkNotNull(snapshot()) { "no photo has been accepted yet" }
        maps.use { it.export(folder) }
    }

    /**
     * Saves the scan into a file, to go on with [restore] after the app has been ended. The scan goes on; a
     * cancelled one cannot be saved.
     */
    fun save(file: File) = Native.sessionSave(this, handle.now, Native.text(file.path))

    /** Limits the work on each photo from now on. */
    fun setBudget(budget: Budget) = Native.sessionSetBudget(
        this, handle.now, budget.seconds ?: -1f, budget.maxSteps, budget.stopWhenInvisible,
    )

    /** Holds the fit; photos are still taken in. */
    fun pause() = Native.sessionPause(this, handle.now)

    /** Goes on after [pause]. */
    fun resume() = Native.sessionResume(this, handle.now)

    /** Ends the fit; photos are refused from now on, maps stay available. */
    fun cancel() = Native.sessionCancel(this, handle.now)

    /**
     * Ends the session, whatever it is doing; no callback comes afterwards. Waits for those on other
     * threads, also for those of photos on their way: hold no lock that they take.
     */
    override fun close() = handle.close()

    companion object {
        /**
         * Goes on with a scan that [save] has written. Of the options count threads, models and
         * memory limit; the rest is in the file.
         */
        @JvmStatic
        @JvmOverloads
        fun restore(
            file: File,
            listener: Listener? = null,
            options: ScanOptions = ScanOptions(),
        ) = MaterialScanner(options, listener, file)

        /** Version of the native library. */
        @JvmStatic val version: String get() = String(Native.version(), Charsets.UTF_8)

        /** Whether the native library was built with a feature. */
        @JvmStatic
        fun has(feature: Feature): Boolean = Native.features() and feature.code != 0L
    }
}
