// Part of svbrdf.hpp: faults, structs with defaults, handles that free themselves, bytes.
#ifndef SVBRDF_CORE_HPP
#define SVBRDF_CORE_HPP

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>

#include "../svbrdf.h"
#include "enums.hpp"

namespace svbrdf {

/// A fault, with its status and the library's message.
class Error : public std::runtime_error {
public:
    explicit Error(svbrdf_status status)
        : std::runtime_error(text(status)), status_(StatusCode{status}) {}
    StatusCode status() const noexcept { return status_; }

private:
    static std::string text(svbrdf_status status) {
        const char* message = svbrdf_last_error_message();
        return *message != '\0' ? message : svbrdf_status_name(status);
    }
    StatusCode status_;
};

/// Throws unless the call was done.
inline void check(svbrdf_status status) {
    if (status != SVBRDF_OK) {
        throw Error(status);
    }
}

/// A struct of svbrdf.h with its defaults, e.g. make(svbrdf_image_init).
template <typename Struct>
Struct make(svbrdf_status (*init)(Struct*, std::size_t)) {
    Struct value{};
    check(init(&value, sizeof value));
    return value;
}

/// Elements in memory that somebody else owns.
template <typename T>
class Span {
public:
    Span() noexcept = default;
    Span(T* data, std::size_t size) noexcept : data_(data), size_(size) {}
    T* data() const noexcept { return data_; }
    std::size_t size() const noexcept { return size_; }
    T* begin() const noexcept { return data_; }
    T* end() const noexcept { return data_ + size_; }
    T& operator[](std::size_t i) const noexcept { return data_[i]; }

private:
    T* data_ = nullptr;
    std::size_t size_ = 0;
};

namespace detail {

/// Owns a handle.
template <typename Handle, svbrdf_status (*destroy)(Handle*)>
class Owner {
public:
    Owner() noexcept = default;
    explicit Owner(Handle* handle) noexcept : handle_(handle) {}
    Owner(Owner&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
    Owner& operator=(Owner&& other) noexcept {
        if (this != &other) {
            reset();
            handle_ = std::exchange(other.handle_, nullptr);
        }
        return *this;
    }
    // Nothing is written: calls on other threads may read the handle until those that use it have ended.
    ~Owner() { destroy(handle_); }
    Handle* get() const noexcept { return handle_; }
    void reset() noexcept { destroy(std::exchange(handle_, nullptr)); }

private:
    Handle* handle_ = nullptr;
};

}  // namespace detail

/// Bytes that the library made.
class Buffer {
public:
    explicit Buffer(svbrdf_buffer* buffer) noexcept : owner_(buffer) {}
    /// Valid as long as this buffer.
    Span<const std::uint8_t> bytes() const {
        const void* data = nullptr;
        std::size_t size = 0;
        check(svbrdf_buffer_view(owner_.get(), &data, &size));
        return {static_cast<const std::uint8_t*>(data), size};
    }

private:
    detail::Owner<svbrdf_buffer, svbrdf_buffer_destroy> owner_;
};

}  // namespace svbrdf

#endif
