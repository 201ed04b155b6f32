#pragma once

#include "preprocess/model.hpp"
#include "preprocess/supports/mls_gradient.hpp"

namespace dimple {

/// A body's surface as small flat pieces: the integral of g n dS is the sum of g(place) area.
struct SurfacePieces {
  Points place;   ///< [3xK] m, in the middle of each
  Points area;    ///< [3xK] m^2: outward normal x area
  Points corner;  ///< [3x3K] m, of each its three
};

/// The body's surface, its triangles divided until none is longer than the spacing of the nodes near it.
SurfacePieces pieces_of(const Discretisation& discretisation);
/// Overload for some triangles between its vertices.
SurfacePieces pieces_of(const Discretisation& discretisation, const Triangles& triangles);

/// Changes the cells' gradients as little as possible so that the divergence theorem holds for every shape
/// function:
///
///     sum_q V_q dphi_qa = integral over the surface of phi_a n dS       for every node a
///
/// while constants and linear fields keep their gradients in every cell. A body under constant stress is then
/// in equilibrium with the tractions of that stress: the patch test holds to rounding for any nodes and
/// cells. Reason: the pressure of nearly incompressible tissue is many times its shear stress. Without it,
/// quadrature errors of a few parts in a thousand in the nodal forces of a constant pressure would move the
/// nodes.
///
/// 1. w_a = integral of phi_a n dS: surface pieces with one point each (pieces_of(), surface_integrals()).
/// 2. Residual r_a = sum_q V_q dphi_qa - w_a, without its part in linear fields over all nodes.
/// 3. Solve sum_q V_q (I - P_q) lambda = r: P_q projects onto the linear fields over the cell's nodes; lambda
///    is a vector for each node. Conjugate gradients, preconditioned by the diagonal and a coarse space.
/// 4. dphi_q := dphi_q - (I - P_q) lambda, the least change in the sense of sum_q V_q |change_q|^2.
/// 5. Report: the largest relative error before and after, and the largest relative change.
///
/// Source: the condition: Krongauz & Belytschko 1997; Chen, Hillman & Rueter 2013 (variational consistency).
/// Departs: they change the test functions only; here the one gradient of energy and force, so that forces
/// remain the derivative of an energy.
///
/// A step of make_model(), after find_supports(): changes dphi and fills consistency_report. `requested`
/// [3xN]: w, of surface_integrals().
void make_consistent(Model& model, const Points& requested);

/// w [m^2]: integral over the surface of phi_a n dS for every node a. Needs the nodes only, no supports.
Points surface_integrals(const Discretisation& discretisation, const SupportOptions& options,
                         const SurfacePieces& surface);

}  // namespace dimple
