# An overlay port that builds the repository it lies in, with the Rust that is installed:
#
#   vcpkg install svbrdf --overlay-ports=ffi/packaging/vcpkg
find_program(CARGO cargo PATHS "$ENV{HOME}/.cargo/bin" REQUIRED)
get_filename_component(SOURCE_PATH "${CURRENT_PORT_DIR}/../../../.." ABSOLUTE)
# Rust's library is built once; programs that are debugged link it as well.
set(VCPKG_BUILD_TYPE release)

vcpkg_check_features(OUT_FEATURE_OPTIONS FEATURE_OPTIONS FEATURES models EMBEDDED_MODELS)
set(OPTIONS --locked --profile dist --package svbrdf-ffi)
if(NOT EMBEDDED_MODELS)
  list(APPEND OPTIONS --no-default-features)
endif()
set(TARGET_DIR "${CURRENT_BUILDTREES_DIR}/${TARGET_TRIPLET}-rel")
vcpkg_execute_required_process(
  COMMAND "${CMAKE_COMMAND}" -E env "CARGO_TARGET_DIR=${TARGET_DIR}" "${CARGO}" build ${OPTIONS}
  WORKING_DIRECTORY "${SOURCE_PATH}"
  LOGNAME "build-${TARGET_TRIPLET}")
vcpkg_execute_required_process(
  COMMAND "${CMAKE_COMMAND}" -E env "SVBRDF_BUILT=${TARGET_DIR}/dist"
    "${SOURCE_PATH}/ffi/install.sh" "${CURRENT_PACKAGES_DIR}"
  WORKING_DIRECTORY "${SOURCE_PATH}"
  LOGNAME "install-${TARGET_TRIPLET}")

if(VCPKG_LIBRARY_LINKAGE STREQUAL "static")
  file(GLOB UNUSED "${CURRENT_PACKAGES_DIR}/lib/libsvbrdf.so*" "${CURRENT_PACKAGES_DIR}/lib/libsvbrdf*.dylib")
else()
  set(UNUSED "${CURRENT_PACKAGES_DIR}/lib/libsvbrdf.a")
endif()
file(REMOVE ${UNUSED})
vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/svbrdf)
vcpkg_fixup_pkgconfig()
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE-MIT" "${SOURCE_PATH}/LICENSE-APACHE")
