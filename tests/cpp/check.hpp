// Helpers of the C++ client.
#ifndef SVBRDF_TEST_CHECK_HPP
#define SVBRDF_TEST_CHECK_HPP

#include <cstdlib>
#include <iostream>
#include <string>

#include "svbrdf.hpp"

#define CHECK(condition)                                                                       \
    do {                                                                                       \
        if (!(condition)) {                                                                    \
            std::cerr << __FILE__ << ":" << __LINE__ << ": " #condition " does not hold\n";    \
            std::exit(1);                                                                      \
        }                                                                                      \
    } while (0)

template <typename Call>
svbrdf::StatusCode thrown(Call call) {
    try {
        call();
    } catch (const svbrdf::Error& error) {
        CHECK(error.what()[0] != '\0');
        return error.status();
    }
    return svbrdf::StatusCode::ok;
}

void lobes(const std::string& folder);

#endif
