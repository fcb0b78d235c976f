// svbrdf for C++17: handles that free themselves, results and exceptions, over svbrdf.h.
//
// What svbrdf.h says about units, threads and callbacks holds here too. Handles may be moved, not
// copied. Faults are thrown as svbrdf::Error; a photo that cannot be used is no fault, see
// Session::push().
#ifndef SVBRDF_HPP
#define SVBRDF_HPP

#include "svbrdf/core.hpp"
#include "svbrdf/maps.hpp"
#include "svbrdf/session.hpp"

#endif
