#include <pybind11/stl.h>

#include <optional>

#include "emseg/edge_directions.hpp"
#include "emseg/part_features.hpp"
#include "emseg/split_apart.hpp"
#include "emseg/warp_events.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

using Indices = Array<std::int64_t>;
using Bounds = std::tuple<double, double, double, double>;

EventView event_view(const Array<std::uint16_t>& x, const Array<std::uint16_t>& y,
                     const Array<std::int64_t>& t) {
  if (x.size() != t.size() || y.size() != t.size()) {
    throw std::invalid_argument("x, y and t differ in length: " + std::to_string(x.size()) + ", " +
                                std::to_string(y.size()) + ", " + std::to_string(t.size()));
  }
  return {view(x), view(y), view(t), {}};
}

MotionModel motion(const std::string& kind, const std::vector<double>& params) {
  return make_motion(motion_kind(kind), params);
}

static_assert(sizeof(Vec2f) == 2 * sizeof(float));

// float32 (n, 2), which owns the places.
py::array_t<float> places_to_numpy(std::vector<Vec2f>&& places) {
  auto* owned = new std::vector<Vec2f>(std::move(places));
  py::capsule owner(owned, [](void* pointer) { delete static_cast<std::vector<Vec2f>*>(pointer); });
  return py::array_t<float>({static_cast<py::ssize_t>(owned->size()), py::ssize_t{2}},
                            reinterpret_cast<const float*>(owned->data()), owner);
}

// Of float32 (n, 2).
std::span<const Vec2f> places_of(const Array<float>& places) {
  if (places.ndim() != 2 || places.shape(1) != 2) {
    throw std::invalid_argument("places have " + std::to_string(places.ndim()) +
                                " dimensions, expected two, the second of length 2");
  }
  return {reinterpret_cast<const Vec2f*>(places.data()), static_cast<std::size_t>(places.shape(0))};
}

std::pair<int, int> grid_shape(const py::array& grid) {
  if (grid.ndim() != 2) {
    throw std::invalid_argument("a grid has " + std::to_string(grid.ndim()) + " dimensions, expected 2");
  }
  return {static_cast<int>(grid.shape(0)), static_cast<int>(grid.shape(1))};
}

std::span<const std::uint8_t> cells_of(const Array<bool>& grid) {
  return {reinterpret_cast<const std::uint8_t*>(grid.data()), static_cast<std::size_t>(grid.size())};
}

Bounds bounds(const Box& box) { return {box.left, box.top, box.right, box.bottom}; }

}  // namespace

void bind_parts(py::module_& m) {
  m.def(
      "connected_components",
      [](const Array<bool>& occupied) {
        const auto [rows, columns] = grid_shape(occupied);
        return to_numpy(connected_components(cells_of(occupied), columns), {rows, columns});
      },
      py::arg("occupied"),
      "Component of every occupied cell, int32 (rows, columns): diagonal neighbours are joined, the one "
      "whose "
      "first cell comes first is 0; -1 elsewhere.");
  m.def(
      "split_apart",
      [](const Array<float>& places, int gap) { return to_numpy(split_apart(places_of(places), gap)); },
      py::arg("places"), py::arg("gap"),
      "Part of every place (n, 2), int32 (n,): parts lie more than about `gap` px apart, the largest is 0; "
      "-1 for "
      "crumbs.");
  m.def(
      "positions_of_values",
      [](const Array<std::int32_t>& values, std::int32_t count) {
        if (count < 0) {
          throw std::invalid_argument("count is " + std::to_string(count) + ", expected 0 or more");
        }
        std::vector<py::array_t<std::int64_t>> positions;
        for (auto& own : positions_of_values(view(values), count))
          positions.push_back(to_numpy(std::move(own)));
        return positions;
      },
      py::arg("values"), py::arg("count"), "Where each of the values 0 .. count-1 stands, int64, rising.");
  m.def(
      "warp_events",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Indices& own, std::int64_t t_ref, const std::string& kind, const std::vector<double>& params,
         const WarpFrame& frame, const std::optional<std::pair<Array<float>, Array<float>>>& undistorted) {
        PixelPlaces places;
        if (undistorted) {
          const auto& [table_x, table_y] = *undistorted;
          places = {view(table_x), view(table_y), grid_shape(table_x).second};
        }
        return places_to_numpy(
            warp_events(event_view(x, y, t), view(own), t_ref, motion(kind, params), frame, places));
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("own"), py::arg("t_ref"), py::arg("kind"),
      py::arg("params"), py::arg("frame"), py::arg("undistorted") = py::none(),
      "Warped places of the events at the positions `own`, float32 (n, 2).");

  m.def(
      "winners_of_tiles",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const std::vector<Indices>& groups, int width, int height, int side) {
        std::vector<std::span<const std::int64_t>> own;
        for (const Indices& group : groups) own.push_back(view(group));
        const TileGrid tiles = tiles_of({width, height}, side);
        return to_numpy(winners_of_tiles(event_view(x, y, t), own, tiles), {tiles.rows, tiles.columns});
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("groups"), py::arg("width"), py::arg("height"),
      py::arg("side"),
      "Which group has most events in each tile, int32 (rows, columns); -1 where none has more than two.");
  m.def(
      "spread_of_tiles",
      [](const Array<bool>& held) { return spread_of_tiles(cells_of(held), grid_shape(held).second); },
      py::arg("held"), "How much of the view tiles span by their second moments: 1 for all of it.");
  m.def(
      "inner_box",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Indices& own, int width,
         int height) { return bounds(inner_box(event_view(x, y, t), view(own), {width, height})); },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("own"), py::arg("width"), py::arg("height"),
      "Left, top, right, bottom of some events' pixels, without the outermost fiftieth on every side.");
  m.def(
      "outer_box", [](const Array<float>& places) { return bounds(outer_box(places_of(places))); },
      py::arg("places"),
      "Left, top, right, bottom of places (n, 2), without the outermost hundredth on every side.");
  m.def(
      "share_gone",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Indices& own, double along_x,
         double along_y) { return share_gone(event_view(x, y, t), view(own), {along_x, along_y}); },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("own"), py::arg("along_x"), py::arg("along_y"),
      "How far some events went, as a share of the displacement, px, that their motion says.");

  m.def(
      "events_beyond",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Array<std::uint8_t>& p, const Indices& own, double along_x, double along_y, int width,
         int height) {
        EventView events = event_view(x, y, t);
        events.p = view(p);
        return events_beyond(events, view(own), {along_x, along_y}, {width, height});
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("own"), py::arg("along_x"),
      py::arg("along_y"), py::arg("width"), py::arg("height"),
      "Events of its own sign that an event of a part meets where its motion would bring it if it went on.");

  m.def(
      "structure_tensors",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Array<std::uint8_t>& p, int width, int height, int side) {
        EventView events = event_view(x, y, t);
        events.p = view(p);
        check_events(events, {width, height});
        const TileGrid tiles = tiles_of({width, height}, side);
        Points points = make_points(events, events.size() ? events.t[0] : 0);
        for (const std::uint8_t positive : events.p) points.sign.push_back(positive != 0 ? 1.0f : -1.0f);
        const BlockGrid grid = make_block_grid(points.view(), {0, 0, width, height}, side);
        py::array_t<double> tensors({py::ssize_t{tiles.rows}, py::ssize_t{tiles.columns}, py::ssize_t{3}});
        double* to = tensors.mutable_data();
        for (const StructureTensor& tensor : structure_tensors(points.view(), grid, edge_slices)) {
          for (const double product : {tensor.xx, tensor.xy, tensor.yy}) *to++ = product;
        }
        return tensors;
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("width"), py::arg("height"),
      py::arg("side"),
      "Structure tensors xx, xy, yy of square tiles, float64 (rows, columns, 3), of signed images of "
      "events.");

  m.def(
      "image_velocity",
      [](const std::string& kind, const std::vector<double>& params, const WarpFrame& frame, double x,
         double y) {
        const Vec2d v = image_velocity(motion(kind, params), frame, {x, y});
        return std::pair(v.x, v.y);
      },
      py::arg("kind"), py::arg("params"), py::arg("frame"), py::arg("x"), py::arg("y"),
      "Velocity, px/s, of what lies at an undistorted place, px.");
  m.def(
      "image_velocities",
      [](const std::string& kind, const std::vector<double>& params, const WarpFrame& frame,
         const Array<double>& places) {
        const auto n = grid_shape(places).first;
        if (grid_shape(places).second != 2) throw std::invalid_argument("places are no (n, 2)");
        const MotionModel model = motion(kind, params);
        py::array_t<double> velocities({py::ssize_t{n}, py::ssize_t{2}});
        for (int k = 0; k < n; ++k) {
          const Vec2d v = image_velocity(model, frame, {places.at(k, 0), places.at(k, 1)});
          velocities.mutable_at(k, 0) = v.x;
          velocities.mutable_at(k, 1) = v.y;
        }
        return velocities;
      },
      py::arg("kind"), py::arg("params"), py::arg("frame"), py::arg("places"),
      "As image_velocity, of places (n, 2): float64 (n, 2).");
}
