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
import kotlin.math.hypot
import kotlin.math.max
import kotlin.math.min
import org.svbrdf.scanner.Action
import org.svbrdf.scanner.Board
import org.svbrdf.scanner.Guidance
import org.svbrdf.scanner.Lighting
import org.svbrdf.scanner.MaterialMaps

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

/** Where to hold the board at first, where the sample is, and which way to go. */
class BoardOverlay(context: Context, attributes: AttributeSet?) : View(context, attributes) {
    private val density = resources.displayMetrics.density
    private val paint = Paint(Paint.ANTI_ALIAS_FLAG).apply {
        style = Paint.Style.STROKE
        strokeWidth = 3f * density
        strokeCap = Paint.Cap.ROUND
    }
    private val path = Path()

    /** The sample's corners, shares of the upright picture; empty: not seen. */
    private var sample: List<FloatArray> = emptyList()

    /** Direction to go, upright, of length 1 at most; null: none. */
    private var way: FloatArray? = null
    private var action: Action? = null

    /** The board in use. */
    var board = Board.DEFAULT

    /** Whether the latest photo was used; null: none yet. */
    var good: Boolean? = null
        set(value) {
            field = value
            invalidate()
        }

    /** Clears the view: there is no result for the camera's image. */
    fun clear() {
        sample = emptyList()
        way = null
        action = null
        good = null
    }

    /** Shows the guidance of a picture of that size, which the screen shows turned by `orientation`. */
    fun guide(guidance: Guidance, width: Int, height: Int, orientation: Int) {
        val corners = guidance.probe.view?.samplePx.orEmpty()
        sample = corners.map { (x, y) -> upright(x / width, y / height, orientation) }
        way = guidance.target?.takeIf { guidance.action == Action.MOVE }?.let { target ->
            // Turned as the picture is; a hand's breadth is a long arrow.
            val (x, y) = target.offsetMm
            val here = upright(0f, 0f, orientation)
            val there = upright(x, y, orientation)
            val long = max(ARROW_MM, hypot(x, y))
            floatArrayOf((there[0] - here[0]) / long, (there[1] - here[1]) / long)
        }
        action = guidance.action
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
    private fun upright(x: Float, y: Float, orientation: Int): FloatArray = when (orientation) {
        90 -> floatArrayOf(1 - y, x)
        180 -> floatArrayOf(1 - x, 1 - y)
        270 -> floatArrayOf(y, 1 - x)
        else -> floatArrayOf(x, y)
    }

    override fun onDraw(canvas: Canvas) {
        paint.color = when {
            action == Action.SHOOT || action == Action.ENOUGH -> Color.rgb(80, 220, 100)
            action == Action.ADJUST || good == false -> Color.rgb(255, 120, 80)
            else -> Color.WHITE
        }
        val shown = if (sample.isEmpty()) start() else listOf(sample)
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
        way?.let { arrow(canvas, it) }
    }

    /** From the middle of the picture. */
    private fun arrow(canvas: Canvas, way: FloatArray) {
        val length = 0.35f * min(width, height)
        val (x, y) = width / 2f to height / 2f
        val (dx, dy) = length * way[0] to length * way[1]
        path.rewind()
        path.moveTo(x, y)
        path.lineTo(x + dx, y + dy)
        for (side in listOf(1f, -1f)) {
            path.moveTo(x + dx, y + dy)
            path.lineTo(x + 0.75f * dx - side * 0.15f * dy, y + 0.75f * dy + side * 0.15f * dx)
        }
        canvas.drawPath(path, paint)
    }

    /** The board from above, filling most of the picture. */
    private fun start(): List<List<FloatArray>> {
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

    private companion object {
        /** Distance that makes the longest arrow, mm. */
        const val ARROW_MM = 120f
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
