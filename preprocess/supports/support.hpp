#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "preprocess/supports/interpolation.hpp"
#include "preprocess/supports/mls_gradient.hpp"
#include "preprocess/surface/sight.hpp"

namespace dimple {

/// For each integration point: its nodes (those whose radius reaches it) and their shape function gradients.
///
/// A place is accepted when its moment matrix is well conditioned and it has at least eight nodes, twice as
/// many as the linear basis has terms; until then all radii are enlarged for that place by a tenth, at most
/// to 2.5 times.
///
/// Where the scheme averages gradients, they are means over the point's cell, by the eight places
/// point + second_moments^(1/2) (+-1, +-1, +-1), which integrate quadratics exactly; and `variance` receives
/// what the mean leaves out of |F|^2. Means make the sum of forces independent of where the points lie; the
/// variance makes it independent of how many there are.
///
/// A step of make_model(): fills support, dphi, variance and support_report from the discretisation, the
/// scheme and the tissues. Where the scheme wants supports connected through the tissue, a node belongs only
/// to points that it sees (sight.hpp); a place that sees too few takes those that are near. Throws ModelError
/// where even that is not enough: the place, the count, what to change.
void find_supports(Model& model);
void find_supports(Model& model, const Sight& sight);
/// The same where `sees`(node, point) says what belongs to what.
using Connected = std::function<bool(int, Index)>;
void find_supports_seen(Model& model, const Connected& sees);

/// What the model's nodes see, if its scheme connects supports through the tissue and something is hidden
/// from some; else nothing. make_model() leaves it in the model.
std::shared_ptr<const Sight> sight_in(const Discretisation& model, const SupportOptions& options);

Interpolation make_interpolation(const Discretisation& cloud, const SupportOptions& options,
                                 const Points& places, const Connected& connected = {});

/// At the vertices of the model's surface, at its points, at its nodes, and at other places inside of it [m],
/// connected as its supports are.
Interpolation surface_interpolation(const Model& model);
/// At some of the vertices.
Interpolation surface_interpolation(const Model& model, const std::vector<Index>& vertices);
/// At places on the surface with outward normals [3xM] of any length.
Interpolation surface_interpolation(const Model& model, const Points& places, const Points& normals);
Interpolation point_interpolation(const Model& model);
Interpolation node_interpolation(const Model& model);
Interpolation inner_interpolation(const Model& model, const Points& places);

/// The field that nodal values stand for, at any number of places in the body and no matter in which order;
/// for images, whose places are too many to keep the shape functions of.
///
/// Where a surface lies between nodes and places it takes, as surface_interpolation() does, the nodes that
/// the nearest integration points are connected with.
class FieldAnywhere {
 public:
  /// `model` must outlive this.
  explicit FieldAnywhere(const Model& model);
  ~FieldAnywhere();
  FieldAnywhere(const FieldAnywhere&) = delete;
  FieldAnywhere& operator=(const FieldAnywhere&) = delete;

  static constexpr Index most_places = 8;
  /// At up to eight places [3 x count, m] near each other: values [3 x count]; and `derivative`, if given:
  /// column k holds d u_i / d x_j of place k, i fastest. Without any memory of earlier calls; several threads
  /// may ask at once.
  void at(const Points& places, const Points& nodal, Points& value,
          Eigen::Matrix<double, 9, Eigen::Dynamic>* derivative = nullptr) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
