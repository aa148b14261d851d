#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "emseg/simulation/simulator.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;
namespace sim = emseg::simulation;

namespace {

using Triple = std::array<double, 3>;

sim::Vec3 vector_of(const Triple& v) { return {v[0], v[1], v[2]}; }

// Rows of x, y, z, qw, qx, qy, qz.
sim::Path path_of(const Array<double>& samples, double interval) {
  if (samples.ndim() != 2 || samples.shape(1) != 7) {
    throw std::invalid_argument("path: expected an array (n, 7) of x, y, z, qw, qx, qy, qz");
  }
  std::vector<sim::Path::Sample> rows;
  const double* value = samples.data();
  for (py::ssize_t k = 0; k < samples.shape(0); ++k, value += 7) {
    rows.push_back({{value[0], value[1], value[2]}, {value[3], value[4], value[5], value[6]}});
  }
  return {std::move(rows), interval};
}

// Poses at the given times, float64 (n, 4, 4).
py::array_t<double> poses_of(const sim::Path& path, const Array<double>& seconds) {
  const std::span<const double> times = view(seconds);
  std::vector<double> matrices;
  matrices.reserve(16 * times.size());
  for (const double t : times) {
    const sim::Pose pose = path.at(t);
    const std::array<double, 3> translation{pose.translation.x, pose.translation.y, pose.translation.z};
    for (std::size_t i = 0; i < 3; ++i) {
      matrices.insert(matrices.end(), {pose.rows[i].x, pose.rows[i].y, pose.rows[i].z, translation[i]});
    }
    matrices.insert(matrices.end(), {0, 0, 0, 1});
  }
  return to_numpy(std::move(matrices), {static_cast<py::ssize_t>(times.size()), 4, 4});
}

int add_surface(sim::Scene& scene, int body, const Triple& origin, const Triple& axis_u, const Triple& axis_v,
                const std::vector<std::array<double, 2>>& polygon, sim::OutlineKind outline, double radius,
                const std::array<std::array<double, 2>, 4>& harmonics, const std::array<double, 2>& pitch,
                double bar, int texture, double texels_per_metre, const std::array<double, 2>& texture_offset,
                int light, bool two_sided) {
  sim::Surface surface;
  surface.body = body;
  surface.origin = vector_of(origin);
  surface.axis_u = vector_of(axis_u);
  surface.axis_v = vector_of(axis_v);
  surface.outline.kind = outline;
  for (const auto& corner : polygon) surface.outline.polygon.push_back({corner[0], corner[1]});
  surface.outline.radius = radius;
  surface.outline.harmonics = harmonics;
  surface.outline.pitch = pitch;
  surface.outline.bar = bar;
  surface.texture = texture;
  surface.texels_per_metre = texels_per_metre;
  surface.texture_offset = texture_offset;
  surface.light = light;
  surface.two_sided = two_sided;
  scene.surfaces.push_back(surface);
  return static_cast<int>(scene.surfaces.size()) - 1;
}

int add_texture(sim::Scene& scene, sim::TextureKind kind, double grain, double density, double low,
                double high, int size, std::uint64_t seed) {
  const sim::TextureOptions options{kind, grain, density, low, high, size, seed};
  py::gil_scoped_release release;
  scene.textures.emplace_back(options);
  return static_cast<int>(scene.textures.size()) - 1;
}

py::typing::Dict<py::str, py::array> simulate(const sim::Scene& scene, const sim::SensorOptions& sensor,
                                              const sim::SimulationOptions& options) {
  sim::SimulatedEvents events;
  {
    py::gil_scoped_release release;
    events = sim::simulate(scene, sensor, options);
  }
  py::typing::Dict<py::str, py::array> columns;
  columns["x"] = to_numpy(std::move(events.x));
  columns["y"] = to_numpy(std::move(events.y));
  columns["t"] = to_numpy(std::move(events.t));
  columns["p"] = to_numpy(std::move(events.p));
  columns["owner"] = to_numpy(std::move(events.owner));
  return columns;
}

py::typing::Dict<py::str, py::array> truth(const sim::Scene& scene, const Array<double>& seconds,
                                           double interval, int threads) {
  const std::span<const double> moments = view(seconds);
  std::vector<sim::Truth> truths;
  {
    py::gil_scoped_release release;
    truths = sim::render_truth(scene, moments, interval, threads);
  }
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(moments.size()), scene.camera.size.height,
                                       scene.camera.size.width};
  const auto stack = [&]<typename T>(std::vector<T> sim::Truth::* image) {
    py::array_t<T> stacked(shape);
    T* target = stacked.mutable_data();
    for (const sim::Truth& found : truths)
      target = std::copy((found.*image).begin(), (found.*image).end(), target);
    return stacked;
  };
  py::typing::Dict<py::str, py::array> images;
  images["intensity"] = stack(&sim::Truth::intensity);
  images["label"] = stack(&sim::Truth::label);
  images["depth"] = stack(&sim::Truth::depth);
  images["flow_x"] = stack(&sim::Truth::flow_x);
  images["flow_y"] = stack(&sim::Truth::flow_y);
  return images;
}

}  // namespace

void bind_simulation(py::module_& m) {
  py::enum_<sim::TextureKind>(m, "TextureKind")
      .value("plain", sim::TextureKind::plain)
      .value("leaves", sim::TextureKind::leaves)
      .value("blocks", sim::TextureKind::blocks)
      .value("checker", sim::TextureKind::checker)
      .value("stripes", sim::TextureKind::stripes)
      .value("clouds", sim::TextureKind::clouds);

  py::enum_<sim::OutlineKind>(m, "OutlineKind")
      .value("polygon", sim::OutlineKind::polygon)
      .value("blob", sim::OutlineKind::blob)
      .value("net", sim::OutlineKind::net);

  py::class_<sim::SensorOptions>(m, "SensorOptions", "Settings of the simulated sensor.")
      .def(py::init<>())
      .def_readwrite("threshold_on", &sim::SensorOptions::threshold_on)
      .def_readwrite("threshold_off", &sim::SensorOptions::threshold_off)
      .def_readwrite("threshold_sigma", &sim::SensorOptions::threshold_sigma)
      .def_readwrite("refractory", &sim::SensorOptions::refractory)
      .def_readwrite("cutoff", &sim::SensorOptions::cutoff)
      .def_readwrite("dark_intensity", &sim::SensorOptions::dark_intensity)
      .def_readwrite("shot_noise", &sim::SensorOptions::shot_noise)
      .def_readwrite("shot_noise_bright", &sim::SensorOptions::shot_noise_bright)
      .def_readwrite("leak", &sim::SensorOptions::leak)
      .def_readwrite("leak_sigma", &sim::SensorOptions::leak_sigma)
      .def_readwrite("hot_fraction", &sim::SensorOptions::hot_fraction)
      .def_readwrite("hot_rate", &sim::SensorOptions::hot_rate)
      .def_readwrite("seed", &sim::SensorOptions::seed);

  py::class_<sim::SimulationOptions>(m, "SimulationOptions", "Settings of a simulation.")
      .def(py::init<>())
      .def_readwrite("duration", &sim::SimulationOptions::duration)
      .def_readwrite("largest_motion", &sim::SimulationOptions::largest_motion)
      .def_readwrite("largest_step", &sim::SimulationOptions::largest_step)
      .def_readwrite("smallest_step", &sim::SimulationOptions::smallest_step)
      .def_readwrite("latency_jitter", &sim::SimulationOptions::latency_jitter)
      .def_readwrite("readout_interval", &sim::SimulationOptions::readout_interval)
      .def_readwrite("threads", &sim::SimulationOptions::threads);

  py::class_<sim::Path>(m, "Path", "A pose through time, cubic between equidistant samples.")
      .def(py::init(&path_of), py::arg("samples"), py::arg("interval"),
           "Samples float64 (n, 7) of x, y, z, qw, qx, qy, qz from time 0 on, `interval` seconds apart.")
      .def("poses", &poses_of, py::arg("seconds"), "Poses at the given times, float64 (n, 4, 4).");

  py::class_<sim::Scene>(m, "Scene", "A scene as the renderer takes it.")
      .def(py::init([](const Camera& camera, const sim::Path& T_world_camera) {
             sim::Scene scene;
             scene.camera = camera;
             scene.T_world_camera = T_world_camera;
             return scene;
           }),
           py::arg("camera"), py::arg("T_world_camera"))
      .def(
          "set_light",
          [](sim::Scene& scene, const Triple& sun, double ambient, double sky) {
            scene.sun = vector_of(sun);
            scene.ambient = ambient;
            scene.sky = sky;
          },
          py::kw_only(), py::arg("sun"), py::arg("ambient"), py::arg("sky"))
      .def(
          "add_light",
          [](sim::Scene& scene, const Array<float>& gain, double interval) {
            const std::span<const float> gains = view(gain);
            scene.lights.push_back({{gains.begin(), gains.end()}, interval});
            return static_cast<int>(scene.lights.size()) - 1;
          },
          py::arg("gain"), py::arg("interval"), "Returns its index.")
      .def(
          "add_body",
          [](sim::Scene& scene, const sim::Path& T_world_body, std::int32_t label) {
            scene.bodies.push_back({T_world_body, label});
            return static_cast<int>(scene.bodies.size()) - 1;
          },
          py::arg("T_world_body"), py::arg("label"), "Returns its index.")
      .def("add_texture", &add_texture, py::kw_only(), py::arg("kind"), py::arg("grain"), py::arg("density"),
           py::arg("low"), py::arg("high"), py::arg("size"), py::arg("seed"), "Returns its index.")
      .def("add_surface", &add_surface, py::kw_only(), py::arg("body"), py::arg("origin"), py::arg("axis_u"),
           py::arg("axis_v"), py::arg("polygon"), py::arg("outline"), py::arg("radius"), py::arg("harmonics"),
           py::arg("pitch"), py::arg("bar"), py::arg("texture"), py::arg("texels_per_metre"),
           py::arg("texture_offset"), py::arg("light"), py::arg("two_sided"), "Returns its index.")
      .def("simulate", &simulate, py::arg("sensor"), py::arg("options"),
           "Events as a dict of columns x, y, t (us), p and owner (label of the surface, -1 noise).")
      .def(
          "truth", &truth, py::arg("seconds"), py::arg("interval"), py::arg("threads") = 0,
          "Images (n, height, width) of what is seen at the given times: intensity, label, depth (m) and the "
          "motion in px over the next interval (s).");
}
