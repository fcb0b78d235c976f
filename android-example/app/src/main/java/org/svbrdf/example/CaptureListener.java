package org.svbrdf.example;

import android.hardware.camera2.CameraCaptureSession;
import android.hardware.camera2.CaptureFailure;
import android.hardware.camera2.CaptureRequest;
import android.hardware.camera2.TotalCaptureResult;
import android.view.Surface;

/**
 * What became of one photo. In Java, because Android 7 calls a method that Android 6 does not know: Kotlin
 * compiles it for one of them only.
 */
abstract class CaptureListener extends CameraCaptureSession.CaptureCallback {
    /** The photo's settings have come. */
    abstract void completed(TotalCaptureResult result);

    /** Its picture, or all of it, will not come. */
    abstract void failed();

    @Override
    public void onCaptureCompleted(
            CameraCaptureSession session, CaptureRequest request, TotalCaptureResult result) {
        completed(result);
    }

    @Override
    public void onCaptureFailed(
            CameraCaptureSession session, CaptureRequest request, CaptureFailure failure) {
        failed();
    }

    // Not marked as overriding: see above.
    public void onCaptureBufferLost(
            CameraCaptureSession session, CaptureRequest request, Surface target, long frame) {
        failed();
    }

    @Override
    public void onCaptureSequenceAborted(CameraCaptureSession session, int sequence) {
        failed();
    }
}
