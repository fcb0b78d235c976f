# find_package(svbrdf): the targets svbrdf::svbrdf (shared library) and svbrdf::svbrdf-static, as
# far as they are installed. svbrdf.h needs C99, svbrdf.hpp C++17.
#
# Installed as PREFIX/lib/cmake/svbrdf, or below a lib folder of another name or depth; or as
# PREFIX/share/svbrdf, where vcpkg moves it.

get_filename_component(_svbrdf_lib "${CMAKE_CURRENT_LIST_DIR}/../.." ABSOLUTE)
find_path(svbrdf_INCLUDE_DIR svbrdf.h
  PATHS "${_svbrdf_lib}/../include" "${_svbrdf_lib}/../../include" "${_svbrdf_lib}/include"
  NO_DEFAULT_PATH)
find_library(svbrdf_SHARED
  NAMES svbrdf
  PATHS "${_svbrdf_lib}" "${_svbrdf_lib}/../bin" "${_svbrdf_lib}/lib"
  NO_DEFAULT_PATH)
find_file(svbrdf_STATIC
  NAMES libsvbrdf.a svbrdf.lib
  PATHS "${_svbrdf_lib}" "${_svbrdf_lib}/lib"
  NO_DEFAULT_PATH)
mark_as_advanced(svbrdf_INCLUDE_DIR svbrdf_SHARED svbrdf_STATIC)

set(svbrdf_FOUND FALSE)
if(svbrdf_INCLUDE_DIR AND svbrdf_SHARED AND NOT svbrdf_SHARED MATCHES "\\.a$")
  set(svbrdf_FOUND TRUE)
  if(NOT TARGET svbrdf::svbrdf)
    # UNKNOWN: what stands there is the library on Unix and its import library on Windows.
    add_library(svbrdf::svbrdf UNKNOWN IMPORTED)
    set_target_properties(svbrdf::svbrdf PROPERTIES
      IMPORTED_LOCATION "${svbrdf_SHARED}"
      INTERFACE_INCLUDE_DIRECTORIES "${svbrdf_INCLUDE_DIR}")
  endif()
endif()
if(svbrdf_INCLUDE_DIR AND svbrdf_STATIC)
  set(svbrdf_FOUND TRUE)
  if(NOT TARGET svbrdf::svbrdf-static)
    add_library(svbrdf::svbrdf-static STATIC IMPORTED)
    set_target_properties(svbrdf::svbrdf-static PROPERTIES
      IMPORTED_LOCATION "${svbrdf_STATIC}"
      INTERFACE_INCLUDE_DIRECTORIES "${svbrdf_INCLUDE_DIR}")
    if(WIN32)
      set_property(TARGET svbrdf::svbrdf-static PROPERTY
        INTERFACE_LINK_LIBRARIES kernel32 ntdll userenv ws2_32 dbghelp)
    else()
      find_package(Threads REQUIRED)
      set_property(TARGET svbrdf::svbrdf-static PROPERTY
        INTERFACE_LINK_LIBRARIES Threads::Threads ${CMAKE_DL_LIBS} m)
    endif()
  endif()
endif()
if(NOT svbrdf_FOUND)
  set(svbrdf_NOT_FOUND_MESSAGE "no svbrdf.h with a library near ${CMAKE_CURRENT_LIST_DIR}")
endif()
