#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "preprocess/supports/interpolation.hpp"
#include "preprocess/supports/mls_gradient.hpp"
#include "preprocess/surface/sight.hpp"

namespace dimple {

/// For each integration point: its nodes and the gradients of their shape functions.
///
/// 1. Candidates: nodes whose radius, R_a = radius_factor h_a, reaches the point or its cell. If the scheme
///    requires it, the point must see them through the tissue (sight.hpp).
/// 2. Places: the point itself; with averaged gradients the eight x_q + S^(1/2) (+-1, +-1, +-1), S the cell's
///    second moments, which integrate quadratics exactly.
/// 3. MLS gradients at each place (mls_gradient.hpp). Accepted with at least eight nodes, twice the terms of
///    the linear basis, and a ratio of the moment matrix's pivots above 1e-5 (above 1e-3 with sight).
/// 4. Else all radii grow for that place in steps of 10 %, up to 2.5 times; at last hidden nodes are used.
/// 5. Averaged: dphi_a = mean over the places; the variance gets K_ab += V_q/8 sum_k (dphi_ka - dphi_a) .
///    (dphi_kb - dphi_b).
///
/// Source: steps 1 and 3 Horton et al. 2007, section 2. Departs: means make the sum of forces independent of
/// the positions of the points, the variance makes it independent of their number. A step of make_model():
/// fills support, dphi, variance and support_report. Throws ModelError where no support suffices: the place,
/// the count, what to change.
void find_supports(Model& model);
void find_supports(Model& model, const Sight& sight);
/// Overload in which `sees`(node, point) decides which nodes belong to a point.
using Connected = std::function<bool(int, Index)>;
void find_supports_seen(Model& model, const Connected& sees);

/// Visibility of the model's nodes, if its scheme connects supports through the tissue and something is
/// hidden from some; else nothing. make_model() keeps it in the model.
std::shared_ptr<const Sight> sight_in(const Discretisation& model, const SupportOptions& options);

Interpolation make_interpolation(const Discretisation& node_set, const SupportOptions& options,
                                 const Points& places, const Connected& connected = {});

/// Shape functions at the vertices of the model's surface, its points, its nodes, and other places inside
/// [m]; connected as its supports are.
Interpolation surface_interpolation(const Model& model);
/// Shape functions at some of the vertices.
Interpolation surface_interpolation(const Model& model, const std::vector<Index>& vertices);
/// Shape functions at places on the surface with outward normals [3xM] of any length.
Interpolation surface_interpolation(const Model& model, const Points& places, const Points& normals);
Interpolation point_interpolation(const Model& model);
Interpolation node_interpolation(const Model& model);
Interpolation inner_interpolation(const Model& model, const Points& places);

/// The field of nodal values at any number of places in the body, in any order; for images, which have too
/// many places to store the shape functions of.
///
/// If a surface separates nodes and places, it uses the nodes that the nearest integration points are
/// connected with, as surface_interpolation() does.
class FieldAnywhere {
 public:
  /// `model` must outlive this.
  explicit FieldAnywhere(const Model& model);
  ~FieldAnywhere();
  FieldAnywhere(const FieldAnywhere&) = delete;
  FieldAnywhere& operator=(const FieldAnywhere&) = delete;

  static constexpr Index most_places = 8;
  /// At up to eight places [3 x count, m] near each other: values [3 x count]; and `derivative`, if given:
  /// column k holds d u_i / d x_j of place k, i fastest. Stateless; several threads may call at once.
  void at(const Points& places, const Points& nodal, Points& value,
          Eigen::Matrix<double, 9, Eigen::Dynamic>* derivative = nullptr) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
