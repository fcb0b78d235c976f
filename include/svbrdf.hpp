// svbrdf for C++17: handles that free themselves, results and exceptions, over svbrdf.h.
//
// The rules of svbrdf.h about units, threads and callbacks hold here too. Handles may be moved, not
// copied. Faults are thrown as svbrdf::Error; a photo that cannot be used is no fault, see
// SessionView::push(). Structs of C are used as they are: make(svbrdf_session_options_init) gives one
// with its defaults, and to_c() turns an enumerator into the number that its field wants.
#ifndef SVBRDF_HPP
#define SVBRDF_HPP

#include "svbrdf/core.hpp"
#include "svbrdf/enums.hpp"
#include "svbrdf/image.hpp"
#include "svbrdf/maps.hpp"
#include "svbrdf/results.hpp"
#include "svbrdf/session.hpp"

#endif
