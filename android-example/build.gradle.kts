// Not run by any check: Google's plugins and SDK are not to be had there. `aar.sh` needs neither.
plugins {
    id("com.android.application") version "8.9.1" apply false
    id("com.android.library") version "8.9.1" apply false
    id("org.jetbrains.kotlin.android") version "2.1.0" apply false
}
