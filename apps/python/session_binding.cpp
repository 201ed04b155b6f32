#include <fmt/format.h>

#include <cmath>
#include <map>
#include <mutex>

#include "apps/python/binding.hpp"
#include "apps/run/live.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/make_model.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "solver/session.hpp"

namespace dimple {
namespace {

// Session that handles one request at a time, from any thread.
class LiveSession {
 public:
  LiveSession(const ModelInMemory& built, const Settings& settings) {
    session_ = computing([&] {
      const Scene scene = resolve(settings.described());
      scene_ = scene;
      check_pairs(scene, Feature::session);
      require_patch_nodes(built, "Session");
      const std::vector<Material> materials = materials_of(scene);
      check_materials(scene, built.model.scheme);
      const TissueOptions tissues = tissues_of(scene, built.label_names, built.model);
      materials_ = materials, label_names_ = built.label_names;
      Model model = make_model(built.model, built.model.scheme, tissue_of_points(built.model, tissues),
                               tissues.density);
      return std::make_unique<Session>(session_on(given(), std::move(model)));
    });
  }

  // Cuts between points on the deformed body [mm, LPS].
  void cut(const Vec3& from, const Vec3& to, double depth) {
    computing([&] {
      const std::lock_guard alone(mutex_);
      const Model& before = session_->model();
      if (!undeformed_) undeformed_.emplace(before.surface.vertex_mm, before.surface.triangles);
      const Points u = session_->nodal_parameters();
      CutSession made = cut_session(given(), before, u, {1e-3 * from, 1e-3 * to, 1e-3 * depth});
      made.session.continue_from(*session_, carried(made.cut, u), made.cut.of_patch);
      *session_ = std::move(made.session);
      to_nodes_ = {};
      return 0;
    });
  }

  // Reads the session with `ask`, without the interpreter's lock, which another thread may need to finish.
  template <class Ask>
  auto now(const Ask& ask) {
    const py::gil_scoped_release others_may_run;
    const std::lock_guard alone(mutex_);
    return ask(*session_);
  }
  template <class Move>
  auto move(const Move& move) {
    return computing([&] {
      const std::lock_guard alone(mutex_);
      return move(*session_);
    });
  }

  Points displacements() {
    return now([&](Session& session) { return displacements_of(session); });
  }
  Points positions() {
    return now([&](Session& session) { return Points(session.model().X + displacements_of(session)); });
  }

 private:
  Points displacements_of(const Session& session) {
    if (to_nodes_.weight.size() == 0) to_nodes_ = node_interpolation(session.model());
    return to_nodes_(session.nodal_parameters());
  }
  SessionGiven given() const {
    return {scene_, materials_, label_names_, undeformed_ ? &*undeformed_ : nullptr, 0.0};
  }

  std::mutex mutex_;
  Scene scene_;
  std::vector<Material> materials_;
  std::map<std::string, int> label_names_;
  std::optional<BodySurface> undeformed_ = {};  // made by the first cut
  std::unique_ptr<Session> session_;
  Interpolation to_nodes_ = {};  // empty until requested after a cut
};

std::string shown(LiveSession& session) {
  return session.now([](Session& s) {
    return fmt::format("<pydimple.Session: {} nodes, {}>", s.model().node_count(),
                       force_title(s.force(), 1e3 * s.depth()));
  });
}

py::array on_tool(LiveSession& session, Index first) {
  const Wrench all = session.now([](Session& s) { return s.on_tool(); });
  return handed_over(std::vector<double>(&all[first], &all[first] + 3), {3});
}

// Members of pydimple.Frame, in its order.
py::tuple frame_of(const LiveFrame& frame) {
  const auto three = [](const Wrench& of, Index first) {
    return py::make_tuple(of[first], of[first + 1], of[first + 2]);
  };
  return py::make_tuple(1e3 * frame.requested, 1e3 * frame.depth, frame.force, frame.error,
                        frame.error_at_depth, three(frame.on_tool, 0), three(frame.on_tool, 3),
                        three(frame.per_force, 0), three(frame.per_force, 3), frame.stiffness, frame.residual,
                        frame.evaluations, name_of(frame.tool));
}

void require(const char* name, double value, bool allowed, const char* why) {
  if (std::isfinite(value) && allowed) return;
  throw UsageError({.fact = fmt::format("{}={} is not allowed", name, value),
                    .where = "Session",
                    .why = why,
                    .remedy = "give another number"});
}

Vec3 place_of(const char* name, const std::vector<double>& mm) {
  require(name, static_cast<double>(mm.size()), mm.size() == 3, "a place has three numbers");
  for (const double number : mm)
    require(name, number, std::abs(number) <= 1e6, "it must be a finite number of no more than a kilometre");
  return {mm[0], mm[1], mm[2]};
}

py::tuple follow(LiveSession& session, double depth_mm, double seconds, std::int64_t evaluations,
                 double dt_s) {
  require("depth_mm", depth_mm, true, "it must be a finite number");
  require("seconds", seconds, seconds > 0.0, "it must be a finite number above 0");
  require("evaluations", static_cast<double>(evaluations), evaluations >= 0, "it must be 0 or more");
  require("dt_s", dt_s, dt_s >= 0.0, "it must be a finite number from 0 on");
  const FrameLimit limit{.seconds = seconds, .evaluations = evaluations};
  return frame_of(session.move([=](Session& s) { return s.follow(1e-3 * depth_mm, limit, dt_s); }));
}

void add_equilibrate(py::class_<LiveSession>& session) {
  session.def(
      "equilibrate",
      [](LiveSession& self, double depth_mm, double dt_s) {
        require("depth_mm", depth_mm, true, "it must be a finite number");
        require("dt_s", dt_s, dt_s >= 0.0, "it must be a finite number from 0 on");
        return self.move([=](Session& s) { return s.equilibrate(1e-3 * depth_mm, dt_s); });
      },
      py::kw_only(), py::arg("depth_mm"), py::arg("dt_s") = 0.0,
      R"(Moves the tool to a depth, or back, and finds the equilibrium there.

Parameters
----------
depth_mm : float
    Depth of the tool below first contact, along its approach direction, millimetres.
dt_s : float
    Duration of the move, seconds: for viscoelastic tissue.

Returns
-------
int
    Force evaluations of the move.

Raises
------
SolveError
    No equilibrium was found; the body is then unchanged.)");
}

void add_cut(py::class_<LiveSession>& session) {
  session.def(
      "cut",
      [](LiveSession& self, const std::vector<double>& from_mm, const std::vector<double>& to_mm,
         double depth_mm) {
        const Vec3 from = place_of("from_mm", from_mm), to = place_of("to_mm", to_mm);
        require("depth_mm", depth_mm, depth_mm > 0.0 && depth_mm <= 1e3,
                "it must be a finite number above 0 and not above 1000");
        if (from == to) require("to_mm", to.x(), false, "a stroke that does not move cuts nothing");
        self.cut(from, to, depth_mm);
      },
      py::kw_only(), py::arg("from_mm"), py::arg("to_mm"), py::arg("depth_mm"),
      R"(Cuts the deformed body: a scalpel moves from place to place on its surface, straight in.

The faces of the cut add nodes at the end of the arrays; the earlier nodes are unchanged.
The next move finds the equilibrium of the cut body.

Parameters
----------
from_mm, to_mm : sequence of 3 floats
    Places on the surface, millimetres, LPS.
depth_mm : float
    Depth of the blade below the straight line between them, millimetres.

Raises
------
ModelError
    The blade misses the body, or cuts off a piece that is not held; the body is then unchanged.
SolveError
    The tissue relaxes.)");
}

void add_step(py::class_<LiveSession>& session) {
  session.def(
      "step",
      [](LiveSession& self, double depth_mm, double dt_s) {
        require("depth_mm", depth_mm, true, "it must be a finite number");
        require("dt_s", dt_s, dt_s > 0.0, "it must be a finite number above 0");
        return self.move([=](Session& s) { return s.step(1e-3 * depth_mm, dt_s); });
      },
      py::kw_only(), py::arg("depth_mm"), py::arg("dt_s"),
      R"(Moves the tool to a depth at constant speed and computes the body with inertia, by central differences.

Parameters
----------
depth_mm : float
    Depth of the tool below first contact, along its approach direction, millimetres.
dt_s : float
    Duration of the move, seconds.

Returns
-------
int
    Number of steps.

Raises
------
SolveError
    More than 20000 steps are needed, or the march fails; the body is then unchanged.)");
}

void add_state(py::class_<LiveSession>& session) {
  session.def("__repr__", [](LiveSession& self) { return shown(self); })
      .def_property_readonly(
          "depth_m", [](LiveSession& self) { return self.now([](Session& s) { return s.depth(); }); },
          "float, metres: depth of the tool below first contact.")
      .def_property_readonly(
          "force_N", [](LiveSession& self) { return self.now([](Session& s) { return s.force(); }); },
          "float, newtons: on the tool along its approach direction, positive where the tissue resists.")
      .def_property_readonly(
          "base_force_N",
          [](LiveSession& self) { return self.now([](Session& s) { return s.base_force(); }); },
          "float, newtons: reaction of the base.")
      .def_property_readonly(
          "force_on_tool_N", [](LiveSession& self) { return on_tool(self, 0); },
          "(3,) float64, newtons, LPS: force vector on the tool; a new array each time.")
      .def_property_readonly(
          "moment_on_tool_Nm", [](LiveSession& self) { return on_tool(self, 3); },
          "(3,) float64, newton metres, LPS: its moment about the centre of the contact patch, which moves "
          "with the tool; a new array each time.")
      .def_property_readonly(
          "displacement_m", [](LiveSession& self) { return handed_over(self.displacements()); },
          "(N, 3) float64, metres, LPS: of each node now; a new array each time.")
      .def_property_readonly(
          "nodal_parameter_m",
          [](LiveSession& self) {
            return handed_over(self.now([](Session& s) { return s.nodal_parameters(); }));
          },
          "(N, 3) float64, metres, LPS: u_a, of which the displacement at X is sum_a phi_a(X) u_a; a new "
          "array each time.")
      .def_property_readonly(
          "positions_m", [](LiveSession& self) { return handed_over(self.positions()); },
          "(N, 3) float64, metres, LPS: the nodes now; a new array each time.")
      .def_property_readonly(
          "forces_N",
          [](LiveSession& self) { return handed_over(self.now([](Session& s) { return s.forces(); })); },
          "(N, 3) float64, newtons, LPS: internal force at each node now; a new array each time.");
}

}  // namespace

void add_session(py::module_& m) {
  py::class_<LiveSession> session(m, "Session");
  session.def(py::init<const ModelInMemory&, const Settings&>());
  add_equilibrate(session);
  add_cut(session);
  add_step(session);
  add_state(session);
  m.def("follow", &follow, py::arg("session"), py::arg("depth_mm"), py::arg("seconds"),
        py::arg("evaluations"), py::arg("dt_s"));
}

}  // namespace dimple
