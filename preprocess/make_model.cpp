#include "preprocess/make_model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/lumped_mass.hpp"
#include "preprocess/side_by_side.hpp"
#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/pressure_patches.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

// Largest fraction of points whose supports had to be enlarged: above it the nodes do not fill the body.
constexpr double most_grown = 0.1;

void refuse_too_many_grown(const Model& model) {
  constexpr double usual = 1.5;
  const SupportReport& support = model.support_report;
  const double fraction = static_cast<double>(support.grown) / static_cast<double>(model.point_count());
  if (model.scheme.support.radius_factor < usual || fraction <= most_grown) return;
  const Vec3 x = model.point.col(std::max<Index>(support.fewest_at, 0)) * 1e3;
  throw ModelError(
      {.fact = fmt::format("{} of {} supports ({:.0f} %) had to be enlarged, up to {:.2f} times, to hold "
                           "enough nodes",
                           support.grown, model.point_count(), 100.0 * fraction, support.largest_growth),
       .where = fmt::format("support domains; fewest nodes, {}, at ({:.2f}, {:.2f}, {:.2f}) mm",
                            support.fewest, x.x(), x.y(), x.z()),
       .why = "the body is thinner than the node spacing, or its nodes are nearly in a plane",
       .remedy = "use more nodes (--nodes) or a smaller --spacing",
       .code = "supports"});
}

}  // namespace

Model make_model(Discretisation places, const Scheme& scheme, Eigen::VectorXi tissue,
                 const std::vector<double>& density, StageTimes* stages) {
  StageTimes here;
  Model model{std::move(places), scheme, std::move(tissue), {}, {}, {}, {}, {}, {}, {}, {}};
  const std::shared_ptr<const Sight> sight = sight_in(model, scheme.support);
  here.done("sight");
  sight ? find_supports(model, *sight) : find_supports(model);
  const bool folded = model.support_report.unseen > 0;
  if (folded) model.sight = sight;
  give_back_memory();
  stop_if_requested();
  refuse_too_many_grown(model);
  here.done("support");

  side_by_side(
      [&] {
        // A fold that hides nodes from points ends the shape functions at the line of sight, inside the body.
        // No integral over its surface then equals the sum of their gradients.
        if (scheme.consistent_gradients && !model.surface.empty() && !folded)
          make_consistent(model, surface_integrals(model, scheme.support, pieces_of(model)));
      },
      [&] {
        if (scheme.pressure_patches) make_pressure_patches(model, folded);
        Eigen::VectorXd of_point(model.point_count());
        for (Index q = 0; q < of_point.size(); ++q)
          of_point[q] = density[static_cast<std::size_t>(model.tissue[q])];
        model.mass = lumped_mass(model, of_point);
      });
  give_back_memory();
  here.done("consistency, patches");
  if (stages) stages->add(here);
  return model;
}

}  // namespace dimple
