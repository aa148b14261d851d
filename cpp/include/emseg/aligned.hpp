// Vectors that begin at a cache line: a load of sixteen floats that straddles two lines counts twice.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace emseg {

constexpr std::size_t cache_line = 64;  // bytes
constexpr std::size_t line_floats = cache_line / sizeof(float);

template <typename T>
struct LineAllocator {
  using value_type = T;

  LineAllocator() = default;
  template <typename U>
  LineAllocator(const LineAllocator<U>&) {}

  T* allocate(std::size_t count) {
    return static_cast<T*>(::operator new(count * sizeof(T), std::align_val_t{cache_line}));
  }
  void deallocate(T* pointer, std::size_t) { ::operator delete(pointer, std::align_val_t{cache_line}); }
  friend bool operator==(const LineAllocator&, const LineAllocator&) { return true; }
};

using LineFloats = std::vector<float, LineAllocator<float>>;

// The next multiple of `unit`.
constexpr std::size_t rounded_up(std::size_t count, std::size_t unit) {
  return (count + unit - 1) / unit * unit;
}

}  // namespace emseg
