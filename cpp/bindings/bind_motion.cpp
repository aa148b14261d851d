#include <pybind11/stl.h>

#include <optional>

#include "emseg/contrast.hpp"
#include "emseg/motion_fit.hpp"
#include "emseg/simd.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

PointView point_view(const Array<float>& x, const Array<float>& y, const Array<float>& dt) {
  if (x.size() != y.size() || x.size() != dt.size()) {
    throw std::invalid_argument("x, y and dt differ in length: " + std::to_string(x.size()) + ", " +
                                std::to_string(y.size()) + ", " + std::to_string(dt.size()));
  }
  return {view(x), view(y), view(dt)};
}

// As large as a sensor of the engine may be, so that no product of its sides leaves an int.
ImageSize checked_size(int width, int height) {
  if (width < 1 || height < 1 || width > 8192 || height > 8192) {
    throw std::invalid_argument("sensor size is " + std::to_string(width) + "x" + std::to_string(height) +
                                ", expected 1..8192 each way");
  }
  return {width, height};
}

void check_polarities(const PointView& points, const Array<std::uint8_t>& p) {
  if (view(p).size() != points.size()) {
    throw std::invalid_argument("p has length " + std::to_string(p.size()) + ", x, y and dt have " +
                                std::to_string(points.size()));
  }
}

}  // namespace

void bind_motion(py::module_& m) {
  m.def(
      "simd_level", [] { return std::string(name_of(simd_level())); },
      "Level of instructions in use: the processor's highest, or a lower one that EMSEG_SIMD names.");
  m.def(
      "simd_levels",
      [] {
        std::vector<std::string> names;
        for (const SimdLevel level : simd_levels()) names.emplace_back(name_of(level));
        return names;
      },
      "Levels that this processor runs, ascending.");

  py::class_<WarpFrame>(m, "WarpFrame",
                        "What warps are relative to: image centre, normalising length, intrinsics.")
      .def(py::init([](int width, int height) { return make_warp_frame(checked_size(width, height)); }),
           py::arg("width"), py::arg("height"))
      .def(py::init([](const Camera& camera) { return make_warp_frame(camera.size, &camera); }),
           py::arg("camera"))
      .def_readonly("cx", &WarpFrame::cx)
      .def_readonly("cy", &WarpFrame::cy)
      .def_readonly("f0", &WarpFrame::f0);

  m.def(
      "warp",
      [](const Array<float>& x, const Array<float>& y, const Array<float>& dt, const std::string& kind,
         const std::vector<double>& params, const WarpFrame& frame) {
        const PointView points = point_view(x, y, dt);
        const MotionModel model = make_motion(motion_kind(kind), params);
        std::vector<float> warped(2 * points.size());
        {
          py::gil_scoped_release release;
          std::visit(
              [&](const auto& motion) {
                const typename std::decay_t<decltype(motion)>::Warp warp(motion, frame);
                for (std::size_t k = 0; k < points.size(); ++k) {
                  const Vec2f at = warp(points.x[k], points.y[k], points.dt[k]);
                  warped[2 * k] = at.x;
                  warped[2 * k + 1] = at.y;
                }
              },
              model);
        }
        return to_numpy(std::move(warped), {x.size(), 2});
      },
      py::arg("x"), py::arg("y"), py::arg("dt"), py::arg("kind"), py::arg("params"), py::arg("frame"),
      "Warped positions, float32 (n, 2).");

  py::class_<IweWorkspace>(m, "IweWorkspace", "Memory of `iwe`, for one call at a time.").def(py::init<>());
  py::class_<ContrastWorkspace>(m, "ContrastWorkspace", "Memory of `contrast`, for one call at a time.")
      .def(py::init<>());
  py::class_<FitWorkspace>(m, "FitWorkspace", "Memory of `fit_motion`, for one call at a time.")
      .def(py::init<>());

  m.def(
      "iwe",
      [](const Array<float>& x, const Array<float>& y, const Array<float>& dt, const std::string& kind,
         const std::vector<double>& params, const WarpFrame& frame, int width, int height, double sigma,
         std::optional<IweWorkspace*> workspace) {
        const PointView points = point_view(x, y, dt);
        const MotionModel model = make_motion(motion_kind(kind), params);
        Image image;
        image.region = sensor_region(checked_size(width, height));  // make_iwe clears it
        {
          py::gil_scoped_release release;
          IweWorkspace own;
          make_iwe(image, points, model, frame, gaussian_taps(sigma), workspace ? **workspace : own);
        }
        return to_numpy(std::move(image.pixels), {height, width});
      },
      py::arg("x"), py::arg("y"), py::arg("dt"), py::arg("kind"), py::arg("params"), py::arg("frame"),
      py::arg("width"), py::arg("height"), py::arg("sigma"), py::arg("workspace") = py::none(),
      "Image of warped events, float32 (height, width). A workspace keeps its memory for the next call.");

  m.def(
      "contrast",
      [](const Array<float>& x, const Array<float>& y, const Array<float>& dt, const std::string& kind,
         const std::vector<double>& params, const WarpFrame& frame, int width, int height, double sigma,
         const std::string& measure, std::optional<ContrastWorkspace*> workspace) {
        const PointView points = point_view(x, y, dt);
        const MotionModel model = make_motion(motion_kind(kind), params);
        const ContrastOptions options{contrast_measure(measure), sigma};
        const Region region = sensor_region(checked_size(width, height));
        ContrastResult result;
        {
          py::gil_scoped_release release;
          ContrastWorkspace own;
          result =
              contrast_and_gradient(points, model, frame, region, options, workspace ? **workspace : own);
        }
        const auto dof = static_cast<std::size_t>(dof_of(kind_of(model)));
        return py::make_tuple(result.value, to_numpy(std::vector<double>(
                                                result.gradient.begin(),
                                                result.gradient.begin() + static_cast<std::ptrdiff_t>(dof))));
      },
      py::arg("x"), py::arg("y"), py::arg("dt"), py::arg("kind"), py::arg("params"), py::arg("frame"),
      py::arg("width"), py::arg("height"), py::arg("sigma") = 1.0, py::arg("measure") = "variance",
      py::arg("workspace") = py::none(),
      "Contrast of the IWE over the sensor and its gradient by the parameters, float64 (dof,).");

  m.def(
      "fit_motion",
      [](const Array<float>& x, const Array<float>& y, const Array<float>& dt, const Array<std::uint8_t>& p,
         const std::string& kind, const WarpFrame& frame, int width, int height, double sigma,
         const std::string& measure, double max_speed, double max_scale_rate, double max_angle_rate,
         int threads, std::optional<FitWorkspace*> workspace) {
        const PointView points = point_view(x, y, dt);
        check_polarities(points, p);
        FitOptions options;
        options.refine.contrast = {contrast_measure(measure), sigma};
        options.refine.bounds = {max_speed, max_scale_rate, max_angle_rate};
        const MotionKind motion = motion_kind(kind);
        const Region region = sensor_region(checked_size(width, height));
        FitResult result;
        {
          py::gil_scoped_release release;
          ThreadPool pool(threads);
          FitWorkspace own;
          result = fit_motion(points, view(p), motion, frame, region, options, pool,
                              workspace ? **workspace : own);
        }
        const auto params = params_of(result.model);
        return py::make_tuple(to_numpy(std::vector<double>(params.begin(), params.end())), result.contrast,
                              result.evaluations);
      },
      py::arg("x"), py::arg("y"), py::arg("dt"), py::arg("p"), py::arg("kind"), py::arg("frame"),
      py::arg("width"), py::arg("height"), py::arg("sigma"), py::arg("measure"), py::arg("max_speed"),
      py::arg("max_scale_rate"), py::arg("max_angle_rate"), py::arg("threads"),
      py::arg("workspace") = py::none(),
      "Model of highest contrast: parameters (dof,), contrast, number of evaluations with gradient. A "
      "workspace keeps its memory for the next call.");
}
