#include <pybind11/stl.h>

#include "emseg/camera.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

Camera make_camera(int width, int height, double fx, double fy, double cx, double cy, DistortionModel model,
                   const std::array<double, 5>& distortion) {
  const Camera camera{{width, height}, fx, fy, cx, cy, model, distortion};
  check_camera(camera);
  return camera;
}

std::pair<py::array_t<float>, py::array_t<float>> undistortion_table(const Camera& camera) {
  UndistortionTable table;
  {
    py::gil_scoped_release release;
    table = make_undistortion_table(camera);
  }
  const std::vector<py::ssize_t> shape{camera.size.height, camera.size.width};
  return {to_numpy(std::move(table.x), shape), to_numpy(std::move(table.y), shape)};
}

template <Point2 (*Map)(const Camera&, Point2)>
std::pair<double, double> map_point(const Camera& camera, double x, double y) {
  const Point2 mapped = Map(camera, {x, y});
  return {mapped.x, mapped.y};
}

}  // namespace

void bind_camera(py::module_& m) {
  py::enum_<DistortionModel>(m, "DistortionModel")
      .value("none", DistortionModel::none)
      .value("radtan", DistortionModel::radtan)
      .value("equidistant", DistortionModel::equidistant);

  py::class_<Camera>(m, "Camera", "Intrinsics and lens distortion; emseg.Camera is its public face.")
      .def(py::init(&make_camera), py::arg("width"), py::arg("height"), py::kw_only(), py::arg("fx"),
           py::arg("fy"), py::arg("cx"), py::arg("cy"), py::arg("model"), py::arg("distortion"),
           "Raise ValueError where the numbers make no camera.")
      .def("undistortion_table", &undistortion_table,
           "Undistorted x and y of every pixel, two float32 arrays (height, width).")
      .def("distort_pixel", &map_point<distort_pixel>, py::arg("x"), py::arg("y"))
      .def("undistort_pixel", &map_point<undistort_pixel>, py::arg("x"), py::arg("y"));
}
