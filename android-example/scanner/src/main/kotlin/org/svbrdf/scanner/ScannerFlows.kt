package org.svbrdf.scanner

import kotlinx.coroutines.channels.BufferOverflow
import kotlinx.coroutines.flow.Flow
import kotlinx.coroutines.flow.MutableSharedFlow
import kotlinx.coroutines.flow.MutableStateFlow
import kotlinx.coroutines.flow.StateFlow
import kotlinx.coroutines.flow.asStateFlow
import kotlinx.coroutines.flow.mapNotNull

/**
 * A scanner's callbacks as flows. Slow collectors see the latest, never a queue:
 *
 *     val flows = ScannerFlows()
 *     val scanner = MaterialScanner(options, flows)
 *     scope.launch { flows.maps.collect { maps -> maps.use { show(it) } } }
 *     val outcome = scanner.addPhotoSuspending(photo)
 */
class ScannerFlows : MaterialScanner.Listener {
    private val latest = MutableStateFlow<Progress?>(null)
    private val newer =
        MutableSharedFlow<MaterialScanner>(replay = 1, onBufferOverflow = BufferOverflow.DROP_OLDEST)

    /** State of the fit; null before the first photo. */
    val progress: StateFlow<Progress?> = latest.asStateFlow()

    /** Maps, whenever there are newer ones; the collector closes them. */
    val maps: Flow<MaterialMaps> = newer.mapNotNull { scanner ->
        try {
            scanner.snapshot()
        } catch (closed: IllegalStateException) {
            null
        }
    }

    override fun onProgress(scanner: MaterialScanner, progress: Progress) {
        latest.value = progress
    }

    override fun onMaps(scanner: MaterialScanner) {
        newer.tryEmit(scanner)
    }
}
