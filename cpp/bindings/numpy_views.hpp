// NumPy arrays as spans, without copying, and vectors as NumPy arrays that own them.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <span>
#include <utility>
#include <vector>

#include "emseg/event.hpp"

namespace emseg::bindings {

namespace py = pybind11;

// C-contiguous array of exactly this dtype: no silent conversion of what is large.
template <typename T>
using Array = py::array_t<T, py::array::c_style>;

template <typename T>
std::span<const T> view(const Array<T>& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}

// Moves a vector into an array of the given shape.
template <typename T>
py::array_t<T> to_numpy(std::vector<T>&& values, std::vector<py::ssize_t> shape = {}) {
  if (shape.empty()) shape = {static_cast<py::ssize_t>(values.size())};
  auto* owned = new std::vector<T>(std::move(values));
  py::capsule owner(owned, [](void* pointer) { delete static_cast<std::vector<T>*>(pointer); });
  return py::array_t<T>(std::move(shape), owned->data(), owner);
}

inline EventView event_view(const Array<std::uint16_t>& x, const Array<std::uint16_t>& y,
                            const Array<std::int64_t>& t, const Array<std::uint8_t>& p) {
  return {view(x), view(y), view(t), view(p)};
}

}  // namespace emseg::bindings
