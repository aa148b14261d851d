#include <pybind11/stl.h>

#include "emseg/segmenter.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

using NamedModel = std::pair<std::string, std::vector<double>>;

std::vector<MotionModel> motions(const std::vector<NamedModel>& named) {
  std::vector<MotionModel> models;
  for (const auto& [kind, params] : named) models.push_back(make_motion(motion_kind(kind), params));
  return models;
}

std::vector<NamedModel> named(const std::vector<MotionModel>& models) {
  std::vector<NamedModel> result;
  for (const MotionModel& model : models) {
    const auto params = params_of(model);
    result.emplace_back(std::string(name_of(kind_of(model))),
                        std::vector<double>(params.begin(), params.end()));
  }
  return result;
}

std::vector<Vec2f> vectors(const Array<float>& columns) {
  if (columns.ndim() != 2 || columns.shape(1) != 2)
    throw std::invalid_argument("places must be an (n, 2) array");
  const std::span<const float> values = view(columns);
  std::vector<Vec2f> result;
  for (std::size_t i = 0; i < values.size(); i += 2) result.push_back({values[i], values[i + 1]});
  return result;
}

SegmenterOptions make_options(const std::string& term, double lambda_data, double lambda_smooth,
                              std::optional<double> lambda_label, double lambda_speed, double lambda_edge,
                              const std::string& polarity_name, const std::string& footprint_name,
                              const std::string& flicker_name, int bracket_row, int bracket_col,
                              double max_speed, double max_scale_rate, double max_angle_rate,
                              const std::vector<std::string>& kinds, int num_iter_segmentation,
                              int num_iter_labeling, const std::string& labelling_name, double sigma,
                              std::optional<std::size_t> max_events, bool mark_noise, int threads) {
  SegmenterOptions options;
  options.data_term = data_term(term);
  options.lambda_data = lambda_data;
  options.lambda_smooth = lambda_smooth;
  options.lambda_label = lambda_label;
  options.lambda_speed = lambda_speed;
  options.lambda_edge = lambda_edge;
  options.polarity = polarity(polarity_name);
  options.footprint = footprint(footprint_name);
  options.flicker = flicker(flicker_name);
  options.bracket_row = bracket_row;
  options.bracket_col = bracket_col;
  options.bounds = {max_speed, max_scale_rate, max_angle_rate};
  options.kinds.clear();
  for (const std::string& kind : kinds) options.kinds.push_back(motion_kind(kind));
  options.num_iter_segmentation = num_iter_segmentation;
  options.num_iter_labeling = num_iter_labeling;
  options.labelling = labelling(labelling_name);
  options.sigma = sigma;
  options.max_events = max_events.value_or(SegmenterOptions::all_events);
  options.mark_noise = mark_noise;
  options.threads = threads;
  options.check();
  return options;
}

}  // namespace

void bind_segmenter(py::module_& m) {
  const SegmenterOptions defaults;
  std::vector<std::string> default_kinds;
  for (const MotionKind kind : defaults.kinds) default_kinds.emplace_back(name_of(kind));
  py::class_<SegmenterOptions>(m, "SegmenterOptions",
                               "Settings of the engine; emseg.Config is their public face.")
      .def(py::init(&make_options), py::kw_only(),
           py::arg("data_term") = std::string(name_of(defaults.data_term)),
           py::arg("lambda_data") = defaults.lambda_data, py::arg("lambda_smooth") = defaults.lambda_smooth,
           py::arg("lambda_label") = defaults.lambda_label, py::arg("lambda_speed") = defaults.lambda_speed,
           py::arg("lambda_edge") = defaults.lambda_edge,
           py::arg("polarity") = std::string(name_of(defaults.polarity)),
           py::arg("footprint") = std::string(name_of(defaults.footprint)),
           py::arg("flicker") = std::string(name_of(defaults.flicker)),
           py::arg("bracket_row") = defaults.bracket_row, py::arg("bracket_col") = defaults.bracket_col,
           py::arg("affine_trans2d_max") = defaults.bounds.speed,
           py::arg("affine_scale_max") = defaults.bounds.scale_rate,
           py::arg("affine_theta_max") = defaults.bounds.angle_rate, py::arg("kinds") = default_kinds,
           py::arg("num_iter_segmentation") = defaults.num_iter_segmentation,
           py::arg("num_iter_labeling") = defaults.num_iter_labeling,
           py::arg("labelling") = std::string(name_of(defaults.labelling)), py::arg("sigma") = defaults.sigma,
           py::arg("max_events") = std::optional(defaults.max_events),
           py::arg("mark_noise") = defaults.mark_noise, py::arg("threads") = defaults.threads,
           "Raise ValueError that names the first setting out of range.")
      .def_property_readonly("kinds",
                             [](const SegmenterOptions& o) {
                               std::vector<std::string> names;
                               for (const MotionKind kind : o.kinds) names.emplace_back(name_of(kind));
                               return names;
                             })
      .def_property_readonly("affine_trans2d_max", [](const SegmenterOptions& o) { return o.bounds.speed; })
      .def_property_readonly("affine_scale_max",
                             [](const SegmenterOptions& o) { return o.bounds.scale_rate; })
      .def_property_readonly("affine_theta_max",
                             [](const SegmenterOptions& o) { return o.bounds.angle_rate; })
      .def_property_readonly("data_term",
                             [](const SegmenterOptions& o) { return std::string(name_of(o.data_term)); })
      .def_readonly("lambda_data", &SegmenterOptions::lambda_data)
      .def_readonly("lambda_smooth", &SegmenterOptions::lambda_smooth)
      .def_readonly("lambda_label", &SegmenterOptions::lambda_label)
      .def_readonly("lambda_speed", &SegmenterOptions::lambda_speed)
      .def_readonly("lambda_edge", &SegmenterOptions::lambda_edge)
      .def_property_readonly("polarity",
                             [](const SegmenterOptions& o) { return std::string(name_of(o.polarity)); })
      .def_property_readonly("footprint",
                             [](const SegmenterOptions& o) { return std::string(name_of(o.footprint)); })
      .def_property_readonly("flicker",
                             [](const SegmenterOptions& o) { return std::string(name_of(o.flicker)); })
      .def_readonly("bracket_row", &SegmenterOptions::bracket_row)
      .def_readonly("bracket_col", &SegmenterOptions::bracket_col)
      .def_readonly("num_iter_segmentation", &SegmenterOptions::num_iter_segmentation)
      .def_readonly("num_iter_labeling", &SegmenterOptions::num_iter_labeling)
      .def_property_readonly("labelling",
                             [](const SegmenterOptions& o) { return std::string(name_of(o.labelling)); })
      .def_readonly("sigma", &SegmenterOptions::sigma)
      .def_property_readonly(
          "max_events",
          [](const SegmenterOptions& o) {
            return o.max_events == SegmenterOptions::all_events ? std::nullopt : std::optional(o.max_events);
          })
      .def_readonly("mark_noise", &SegmenterOptions::mark_noise)
      .def_readonly("threads", &SegmenterOptions::threads);

  py::class_<Segmentation>(m, "Segmentation", "What the engine makes of one window.")
      .def_property_readonly(
          "labels", [](const Segmentation& s) { return to_numpy(std::vector<std::int32_t>(s.labels)); })
      .def_property_readonly("models", [](const Segmentation& s) { return named(s.models); })
      .def_readonly("t_ref", &Segmentation::t_ref)
      .def_readonly("energy", &Segmentation::energy)
      .def_readonly("energy_trace", &Segmentation::energy_trace)
      .def_readonly("reference_sharpness", &Segmentation::reference_sharpness)
      .def_readonly("thinned", &Segmentation::thinned)
      .def_readonly("timings", &Segmentation::timings);

  py::class_<Segmenter>(m, "Segmenter",
                        "The engine for one sensor: keeps tables, threads and memory between windows.")
      .def(py::init([](int width, int height, const SegmenterOptions& options,
                       const std::optional<Camera>& camera,
                       const std::optional<std::pair<Array<float>, Array<float>>>& undistortion) {
             const ImageSize size{width, height};
             std::optional<UndistortionTable> table;
             if (undistortion) {
               const auto x = view(undistortion->first), y = view(undistortion->second);
               table = UndistortionTable{size, {x.begin(), x.end()}, {y.begin(), y.end()}};
             }
             return std::make_unique<Segmenter>(size, camera, options, std::move(table));
           }),
           py::arg("width"), py::arg("height"), py::arg("options"), py::arg("camera") = std::nullopt,
           py::arg("undistortion") = std::nullopt,
           "The camera's undistortion table, where it is made already, saves making it.")
      .def(
          "segment",
          [](Segmenter& segmenter, const Array<std::uint16_t>& x, const Array<std::uint16_t>& y,
             const Array<std::int64_t>& t, const Array<std::uint8_t>& p, std::optional<std::int64_t> t_ref,
             const std::vector<NamedModel>& pool, const std::vector<NamedModel>& candidates,
             const std::vector<std::tuple<NamedModel, Array<float>, double>>& tracked) {
            const EventView events = event_view(x, y, t, p);
            WindowPrior prior{t_ref, motions(pool), motions(candidates), {}};
            for (const auto& [model, places, seen] : tracked)
              prior.tracked.push_back({motions({model}).front(), vectors(places), seen});
            py::gil_scoped_release release;
            return segmenter.segment(events, prior);
          },
          py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("t_ref") = std::nullopt,
          py::arg("pool") = std::vector<NamedModel>{}, py::arg("candidates") = std::vector<NamedModel>{},
          py::arg("tracked") = std::vector<std::tuple<NamedModel, Array<float>, double>>{},
          "Segment one window.  Models are (kind, parameters); an empty pool is searched for.  Tracked "
          "objects are "
          "(model, places, px, when they were there, s after t_ref).")
      .def(
          "motion_losses",
          [](const Segmenter& segmenter, const Array<std::uint16_t>& x, const Array<std::uint16_t>& y,
             const Array<std::int64_t>& t, const Array<std::uint8_t>& p, std::int64_t t_ref, double window,
             const NamedModel& own, const NamedModel& other,
             const std::vector<std::pair<float, float>>& offsets) {
            const auto motion = motions({own, other});
            std::vector<Vec2f> px;
            for (const auto& [dx, dy] : offsets) px.push_back({dx, dy});
            return segmenter.motion_losses(event_view(x, y, t, p), t_ref, window, motion[0], motion[1], px);
          },
          py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("t_ref"), py::arg("window"),
          py::arg("own"), py::arg("other"), py::arg("offsets"),
          "Nats an event that the other motion, moved by each offset (px over the window), loses against the "
          "own.");
}
