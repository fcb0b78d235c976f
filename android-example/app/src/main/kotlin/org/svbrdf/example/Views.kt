package org.svbrdf.example

import android.content.Context
import android.graphics.Bitmap
import android.graphics.Canvas
import android.graphics.Color
import android.graphics.Paint
import android.graphics.Path
import android.graphics.Rect
import android.util.AttributeSet
import android.view.MotionEvent
import android.view.View
import android.widget.FrameLayout
import java.nio.ByteBuffer
import kotlin.math.min
import org.svbrdf.scanner.Board
import org.svbrdf.scanner.Camera
import org.svbrdf.scanner.Lighting
import org.svbrdf.scanner.MaterialMaps
import org.svbrdf.scanner.Pose

/** As wide as it may be, with the shape of the upright preview. */
class FinderLayout(context: Context, attributes: AttributeSet?) :
    FrameLayout(context, attributes) {
    /** Height over width. */
    var shape = 4f / 3f
        set(value) {
            field = value
            requestLayout()
        }

    override fun onMeasure(width: Int, height: Int) {
        val wide = MeasureSpec.getSize(width)
        val high = MeasureSpec.makeMeasureSpec((wide * shape).toInt(), MeasureSpec.EXACTLY)
        super.onMeasure(MeasureSpec.makeMeasureSpec(wide, MeasureSpec.EXACTLY), high)
    }
}

/** Where to hold the board, and where the latest photo had it. */
class BoardOverlay(context: Context, attributes: AttributeSet?) : View(context, attributes) {
    private val paint = Paint(Paint.ANTI_ALIAS_FLAG).apply {
        style = Paint.Style.STROKE
        strokeWidth = 3f * resources.displayMetrics.density
    }
    private val path = Path()
    private var seen: List<List<FloatArray>> = emptyList()

    /** The board in use. */
    var board = Board.DEFAULT

    /** Whether the latest photo was used; null: none yet. */
    var good: Boolean? = null
        set(value) {
            field = value
            invalidate()
        }

    /** Shows where a photo of `camera` had the board, whose picture the screen shows turned by `orientation`. */
    fun show(pose: Pose?, camera: Camera?, orientation: Int) {
        seen = if (pose == null || camera == null) {
            emptyList()
        } else {
            outlines().mapNotNull { outline ->
                val points = outline.map { (x, y) -> pose.project(camera, x, y) }
                if (points.any { it == null }) {
                    null
                } else {
                    points.map { upright(it!![0] / camera.width, it[1] / camera.height, orientation) }
                }
            }
        }
        invalidate()
    }

    /** Corners of the board and of its hole, mm from the hole's centre. */
    private fun outlines(): List<List<Pair<Double, Double>>> {
        val s = board.squareMm
        val centerX = 0.5 * (board.holeColStart + board.holeColEnd)
        val centerY = 0.5 * (board.holeRowStart + board.holeRowEnd)
        fun corners(top: Int, left: Int, bottom: Int, right: Int) =
            listOf(left to top, right to top, right to bottom, left to bottom)
                .map { (x, y) -> s * (x - centerX) to s * (centerY - y) }
        return listOf(
            corners(0, 0, board.rows, board.cols),
            corners(board.holeRowStart, board.holeColStart, board.holeRowEnd, board.holeColEnd),
        )
    }

    /** From shares of the sensor's picture to shares of the upright one. */
    private fun upright(x: Double, y: Double, orientation: Int): FloatArray = when (orientation) {
        90 -> floatArrayOf((1 - y).toFloat(), x.toFloat())
        180 -> floatArrayOf((1 - x).toFloat(), (1 - y).toFloat())
        270 -> floatArrayOf(y.toFloat(), (1 - x).toFloat())
        else -> floatArrayOf(x.toFloat(), y.toFloat())
    }

    override fun onDraw(canvas: Canvas) {
        val shown = seen.ifEmpty { guide() }
        paint.color = when (good) {
            null -> Color.WHITE
            true -> Color.rgb(80, 220, 100)
            false -> Color.rgb(255, 120, 80)
        }
        for (outline in shown) {
            path.rewind()
            outline.forEachIndexed { i, point ->
                val x = point[0] * width
                val y = point[1] * height
                if (i == 0) path.moveTo(x, y) else path.lineTo(x, y)
            }
            path.close()
            canvas.drawPath(path, paint)
        }
    }

    /** The board from above, filling most of the picture. */
    private fun guide(): List<List<FloatArray>> {
        val s = board.squareMm
        val scale = 0.88 * min(width / (board.cols * s), height / (board.rows * s))
        return outlines().map { outline ->
            outline.map { (x, y) ->
                floatArrayOf(
                    (0.5 + scale * x / width).toFloat(), (0.5 - scale * y / height).toFloat(),
                )
            }
        }
    }
}

/** The material under a light that the finger moves. */
class RelitView(context: Context, attributes: AttributeSet?) : View(context, attributes) {
    private val paint = Paint(Paint.FILTER_BITMAP_FLAG)
    private val place = Rect()
    private var bitmap: Bitmap? = null
    private var pixels = ByteBuffer.allocateDirect(0)
    private val light = floatArrayOf(60f, 60f, 120f)

    /** The maps to show, small ones; they are closed when others come. */
    var material: MaterialMaps? = null
        set(value) {
            field?.close()
            field = value
            render()
        }

    private fun render() {
        val material = material
        if (material == null) {
            bitmap = null
            invalidate()
            return
        }
        var shown = bitmap
        if (shown == null || shown.width != material.width || shown.height != material.height) {
            shown = Bitmap.createBitmap(material.width, material.height, Bitmap.Config.ARGB_8888)
            pixels = ByteBuffer.allocateDirect(4 * material.width * material.height)
            bitmap = shown
        }
        material.render(Lighting(light), pixels)
        pixels.rewind()
        shown!!.copyPixelsFromBuffer(pixels)
        invalidate()
    }

    override fun onTouchEvent(event: MotionEvent): Boolean {
        if (event.actionMasked == MotionEvent.ACTION_UP) {
            performClick()
        }
        // Twice as far as the sample reaches.
        light[0] = 200f * (event.x / width - 0.5f)
        light[1] = 200f * (0.5f - event.y / height)
        render()
        return true
    }

    override fun performClick(): Boolean {
        super.performClick()
        return true
    }

    override fun onDraw(canvas: Canvas) {
        place.set(0, 0, width, height)
        bitmap?.let { canvas.drawBitmap(it, null, place, paint) }
    }
}
