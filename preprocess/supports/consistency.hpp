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
SurfacePieces pieces_of(const Discretisation& cloud);
/// Likewise of some triangles between its vertices.
SurfacePieces pieces_of(const Discretisation& cloud, const Triangles& triangles);

/// Changes the cells' gradients, as little as possible, so that the divergence theorem holds for every shape
/// function:
///
///     sum_q V_q dphi_qa = integral over the surface of phi_a n dS       for every node a
///
/// while constants and linear fields keep their gradients in every cell. Then a body under constant stress is
/// in equilibrium with the tractions of that stress: the patch test holds to rounding, wherever nodes and
/// cells lie. It matters because the pressure of nearly incompressible tissue is many times its shear stress:
/// what quadrature leaves of a constant pressure's nodal forces, a few parts in a thousand, would move the
/// nodes.
///
/// The least change, in the sense of sum_q V_q |change_q|^2, is change_q = -(I - P_q) lambda, P_q the
/// projection onto linear fields over the cell's nodes and lambda a value per node and direction, from one
/// sparse symmetric system. Source:   the condition: Krongauz & Belytschko 1997; Chen, Hillman & Rueter 2013
/// (variational consistency). Departs:  they change the test functions only; here the one gradient of energy
/// and force, so that forces stay the
///           derivative of an energy.
///
/// A step of make_model(), after find_supports(): changes dphi and fills consistency_report. `wanted` [3xN]:
/// those integrals, of surface_integrals().
void make_consistent(Model& model, const Points& wanted);

/// Integral over the surface of phi_a n dS for every node a [m^2], from the places alone: no supports needed.
Points surface_integrals(const Discretisation& cloud, const SupportOptions& options,
                         const SurfacePieces& surface);

}  // namespace dimple
