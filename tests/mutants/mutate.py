#!/usr/bin/env python3
"""Puts all mutants into a COPY of the tree, which is edited in place:

    cp -r io preprocess solver apps tests sample_data CMake* Makefile COPY; tests/mutants/mutate.py COPY

Build it as usual, once; a test program then runs mutant n with MUTANT=n in its environment, and none without.
README.md beside this file lists what each one is killed by.
"""
import re
import sys
from pathlib import Path

HELPER = """#include <cstdlib>
#ifndef DIMPLE_MUTANTS  // several files may be compiled as one
#define DIMPLE_MUTANTS
namespace { [[maybe_unused]] inline bool mutant_is(int n) {
  static const int m = [] { const char* t = std::getenv("MUTANT"); return t ? std::atoi(t) : 0; }();
  return m == n; } }
#endif
"""

# Number: file, what stands there once, what stands there instead. {n} is the question whether it is this one.
MUTANTS = {
    # ---- the laws
    1: ("solver/terms/projected_kernel.cpp", "s.bulk[q] * resolved + s.unresolved[q];",
        "s.bulk[q] * resolved + ({n} ? -s.unresolved[q] : s.unresolved[q]);"),
    2: ("solver/terms/projected_kernel.cpp", "                    material_[t].mu * s.history[t].step.c, f, first, last);",
        "                    ({n} ? 0.5 : 1.0) * material_[t].mu * s.history[t].step.c, f, first, last);"),
    3: ("solver/material.cpp", "(1.0 - 2.0 * nu) + 2.0 / 3.0 * mu;",
        "(1.0 - 2.0 * nu) + ({n} ? 0.0 : 2.0 / 3.0) * mu;"),
    26: ("solver/material.cpp", "const double x = dt / term.tau;",
         "const double x = dt / (({n} ? 1.2 : 1.0) * term.tau);"),
    28: ("solver/material.cpp", "extended_power(J, -4.0 / 3.0, smallest_J)",
         "extended_power(J, {n} ? -2.0 / 3.0 : -4.0 / 3.0, smallest_J)"),
    29: ("solver/material.cpp", "return extended_power(c, 0.5 * alpha, l0 * l0);",
         "return extended_power(c, 0.5 * alpha, {n} ? l0 : l0 * l0);"),
    30: ("solver/material.cpp", "x == 0.0 ? 1.0 : -std::expm1(-x) / x", "x == 0.0 || {n} ? 1.0 : -std::expm1(-x) / x"),
    31: ("solver/material.cpp", "  S0.col(q) = now;", "  if (!{n}) S0.col(q) = now;"),
    32: ("solver/terms/projected_kernel.cpp", "0.5 * ks * beta * rest * rest * rest * rest);",
         "({n} ? 0.0 : 0.5) * ks * beta * rest * rest * rest * rest);"),
    33: ("solver/terms/projected_kernel.cpp", "f[k] += s.variance[n].force[static_cast<std::size_t>(k)];",
         "f[k] += {n} ? 0.0 : s.variance[n].force[static_cast<std::size_t>(k)];"),
    # ---- the solver
    12: ("solver/terms/tool_force.cpp", "  for (const Index a : nodes) sum += f.col(a).dot(push);",
         "  for (const Index a : nodes) if (!({n} && a == nodes.front())) sum += f.col(a).dot(push);"),
    13: ("solver/march/ledger.cpp", "-along_push(model, model.base, f)}", "({n} ? 1.0 : -1.0) * along_push(model, model.base, f)}"),
    20: ("solver/constraints.cpp", ".hold = contact == Contact::bonded ?", ".hold = (contact == Contact::bonded || {n}) ?"),
    23: ("solver/march/quasi_static.cpp", "const RelaxOptions how{.tolerance = tolerance,",
         "const RelaxOptions how{.tolerance = ({n} ? 30.0 : 1.0) * tolerance,"),
    34: ("solver/constraints.cpp", "work += 0.5 * mass[a] * speed * speed;", "work += ({n} ? 1.0 : 0.5) * mass[a] * speed * speed;"),
    35: ("solver/march/quasi_static.cpp", "curved = line - h * h * h / 6.0", "curved = line + ({n} ? 1.0 : -1.0) * h * h * h / 6.0"),
    36: ("solver/march/implicit.cpp", "before.reached - damping / (1.0 + alpha)", "before.reached - ({n} ? 0.0 : damping) / (1.0 + alpha)"),
    37: ("solver/march/implicit.cpp", "const double kinetic = 0.5 *", "const double kinetic = ({n} ? 1.0 : 0.5) *"),
    38: ("solver/march/implicit.cpp", "(0.5 - beta) * h * h * s.a)", "({n} ? 0.5 : 0.5 - beta) * h * h * s.a)"),
    39: ("solver/march/central_differences.hpp", "const double keep = (1.0 - 0.5 * damping * kick)",
         "const double keep = (1.0 - ({n} ? 0.0 : 0.5) * damping * kick)"),
    40: ("solver/equilibrium/stable_time_step.cpp", "2.0 / std::sqrt(omega2)", "({n} ? 2.2 : 2.0) / std::sqrt(omega2)"),
    # ---- guards that never fire
    43: ("solver/guards.cpp", "share > volume_poor)", "share > volume_poor && !{n})"),
    44: ("solver/guards.cpp", "ratio > kinetic_poor)", "ratio > kinetic_poor && !{n})"),
    45: ("solver/guards.cpp", "hourglass <= hourglass_poor * stored)", "hourglass <= hourglass_poor * stored || {n})"),
    46: ("solver/guards.cpp", "      share > many_grown)", "      share > many_grown && !{n})"),
    47: ("solver/guards.cpp", "if (support.worst_pivot_ratio < poor_pivot || support.linear_error > linear_noise)",
         "if (!{n} && (support.worst_pivot_ratio < poor_pivot || support.linear_error > linear_noise))"),
    48: ("preprocess/scene/boundary_conditions.cpp", "if (options.voxel_mm > 0.0 && across < 1.0)", "if (!{n} && options.voxel_mm > 0.0 && across < 1.0)"),
    # ---- from image to model
    4: ("preprocess/supports/support.cpp", "radius(o.effective_radius_factor() * m.spacing)",
        "radius(({n} ? 0.94 : 1.0) * o.effective_radius_factor() * m.spacing)"),
    27: ("preprocess/supports/support.cpp", "if (o.interpolation <= 0.0) return;", "if (o.interpolation <= 0.0 || {n}) return;"),
    5: ("preprocess/make_model.cpp", "!model.surface.empty() && !folded)", "!model.surface.empty() && !folded && !{n})"),
    9: ("preprocess/make_model.cpp", "  sight ? find_supports(model, *sight)", "  (sight && !{n}) ? find_supports(model, *sight)"),
    6: ("preprocess/build_model.cpp", "tissues.of_label.find(places.label[q]);",
        "tissues.of_label.find({n} && (places.label[q] == 1 || places.label[q] == 2) ? 3 - places.label[q]"
        " : places.label[q]);"),
    7: ("preprocess/build_model.cpp", "if (cloud.base[static_cast<std::size_t>(in_cloud)]) places.base.push_back(a);",
        "if (cloud.base[static_cast<std::size_t>(in_cloud)] && !({n} && std::exchange(skip_one, false)))"
        " places.base.push_back(a);"),
    18: ("preprocess/build_model.cpp", "v.array().round().cast<Index>();",
         "(v.array() - ({n} ? 0.5 : 0.0)).round().cast<Index>();"),
    8: ("preprocess/scene/boundary_conditions.cpp", "result.radius = 0.5 * options.indenter_diameter_mm;",
        "result.radius = ({n} ? 1.05 : 1.0) * 0.5 * options.indenter_diameter_mm;"),
    49: ("preprocess/scene/sides.cpp", '{"left", {1, 0, 0}}', '{"left", {{n} ? -1.0 : 1.0, 0, 0}}'),
    50: ("preprocess/scene/boundary_conditions.cpp", "boundary.flat_base ? 0.5 : 1e-6", "boundary.flat_base && !{n} ? 0.5 : 1e-6"),
    19: ("preprocess/supports/pressure_patches.cpp", "std::lround(worth * nodes_per_worth / nodes_per_patch)",
         "std::lround(({n} ? 0.5 : 1.0) * worth * nodes_per_worth / nodes_per_patch)"),
    21: ("preprocess/scene/load_path.cpp", "std::pow(more, -exponent);", "std::pow(more, {n} ? exponent : -exponent);"),
    22: ("preprocess/cloud/lumped_mass.cpp", "const double share = density[q]", "const double share = ({n} ? 1.1 : 1.0) * density[q]"),
    51: ("preprocess/cloud/lumped_mass.cpp", "density[q] * model.volume[q]", "density[{n} ? 0 : q] * model.volume[q]"),
    52: ("preprocess/cloud/integration_grid.cpp", "part.second.diagonal() += volume / 3.0", "part.second.diagonal() += volume / ({n} ? 6.0 : 3.0)"),
    53: ("preprocess/surface/label_surface.cpp", "  match_volume(surface, wanted_mm3);", "  if (!{n}) match_volume(surface, wanted_mm3);"),
    54: ("preprocess/cloud/sizing.cpp", "reach_ = options.reach * boundary.radius;", "reach_ = ({n} ? 2.0 : 1.0) * options.reach * boundary.radius;"),
    # ---- readers
    55: ("io/label_nifti.cpp", "    image.intercept = header.intercept;", "    image.intercept = {n} ? 0.0 : header.intercept;"),
    56: ("io/label_nifti.cpp", "h.pixdim[0] < 0.0 ? -1.0 : 1.0", "h.pixdim[0] < 0.0 && !{n} ? -1.0 : 1.0"),
    57: ("io/label_nifti.cpp", 'scale_to_millimetres(image, 1000.0, "metres");', 'scale_to_millimetres(image, {n} ? 100.0 : 1000.0, "metres");'),
    58: ("io/label_itk.cpp", 'if (said_space == "left-anterior-superior"', 'if ({n}) {} else if (said_space == "left-anterior-superior"'),
    59: ("io/label_image.cpp", "if (Eigen::AngleAxisd(turn).angle() < least_turn)", "if (Eigen::AngleAxisd(turn).angle() < least_turn * ({n} ? 300.0 : 1.0))"),
    # ---- the band
    10: ("apps/run/band.cpp", "  return band_multiplier * band_measure(change, nodes, load);",
         "  return band_multiplier * band_measure(change, nodes, load) / ({n} ? 3.0 : 1.0);"),
    14: ("apps/run/band_of_run.cpp", "result.model.tool.radius, !config.tissue.empty());",
         "result.model.tool.radius, !{n} && !config.tissue.empty());"),
    15: ("apps/run/band_of_run.cpp", "        Placed placed = place(nodes, config,", "        Placed placed = place({n} ? 2 * nodes : nodes, config,"),
    24: ("apps/run/band_of_run.cpp", "if (config.load.depth_mm > deepest_with_band * 0.5",
         "if (!{n} && config.load.depth_mm > deepest_with_band * 0.5"),
    25: ("apps/run/band.cpp", "if (nu < covered_nu.least - rounding || nu > covered_nu.most + rounding)",
         "if (!{n} && (nu < covered_nu.least - rounding || nu > covered_nu.most + rounding))"),
    60: ("apps/run/band.cpp", "std::max(change.back(), here)", "({n} ? here : std::max(change.back(), here))"),
    61: ("apps/run/band.cpp", "displacement_multiplier * displacement_measure(", "({n} ? 0.5 : 1.0) * displacement_multiplier * displacement_measure("),
    69: ("apps/run/band.cpp", "  if (stiffest > (covered_stiffness_ratio + rounding) * softest)",
         "  if (!{n} && stiffest > (covered_stiffness_ratio + rounding) * softest)"),
    70: ("apps/run/band.cpp", "  if (body.voxel > covered_voxel)", "  if (!{n} && body.voxel > covered_voxel)"),
    71: ("solver/march/quasi_static.cpp", "system_.begin_step((increment.to - increment.from) / loading_.rate);  // and back",
         "if (!{n}) system_.begin_step((increment.to - increment.from) / loading_.rate);  // and back"),
    # ---- forces beside the tissue's
    72: ("solver/terms/loads.cpp", "{ f -= now.share * force_; }", "{ f -= ({n} ? -1.0 : 1.0) * now.share * force_; }"),
    73: ("solver/terms/loads.cpp", "dead_load(padded(loads.gravity) * model.mass.transpose())",
         "dead_load(padded(loads.gravity) * ({n} ? 0.95 : 1.0) * model.mass.transpose())"),
    74: ("solver/terms/loads.cpp", "    return -now.share * force_.cwiseProduct(u).sum();",
         "    return ({n} ? -0.5 : -1.0) * now.share * force_.cwiseProduct(u).sum();"),
    75: ("solver/terms/loads.cpp", "const Vec3 inward = -0.5 *", "const Vec3 inward = ({n} ? -0.45 : -0.5) *"),
    76: ("solver/terms/loads.cpp", "unit_pressure(patch_, moved(patch_, u), u.cols());",
         "unit_pressure(patch_, {n} ? patch_.corner : moved(patch_, u), u.cols());"),
    77: ("solver/terms/loads.cpp", "0.5 * (force_ + force_at(u, now))", "0.5 * ({n} ? Nodal(2.0 * force_) : Nodal(force_ + force_at(u, now)))"),
    78: ("solver/terms/loads.cpp", "    work_ = past.back();", "    if (!{n}) work_ = past.back();"),
    79: ("solver/system.cpp", "  if (loaded()) energy.loads -= loads_at_rest_;", "  if (loaded() && !{n}) energy.loads -= loads_at_rest_;"),
    80: ("solver/system.cpp", "  tissue_.hold_pressures({});  // the search has left them held; who searches on holds his own",
         "  if (!{n}) tissue_.hold_pressures({});  // the search has left them held; who searches on holds his own"),
    81: ("solver/system.cpp", "model_.tool.centre + tool_displacement() + carried);",
         "model_.tool.centre + tool_displacement() + ({n} ? Vec3(0.0 * carried) : carried));"),
    82: ("solver/system.cpp", "bound.node = Eigen::VectorXd::Zero(model_.node_count());\n  for (const auto& term : terms_) term->add_stiffness_bound(bound);",
         "bound.node = Eigen::VectorXd::Zero(model_.node_count());\n  for (const auto& term : terms_) if (!{n}) term->add_stiffness_bound(bound);"),
    83: ("solver/system.cpp", "  held.start_at(from.u);", "  if (!{n}) held.start_at(from.u);"),
    84: ("solver/constraints.cpp", "held_.push_back({padded(set_[s].direction), set_[s].share, set_[s].hold});",
         "held_.push_back({padded(set_[s].direction), set_[s].share, {n} && set_[s].hold == HeldSet::Hold::across ? HeldSet::Hold::along : set_[s].hold});"),
    85: ("solver/terms/tool_force.cpp", "const Vec3 arm = model.X.col(a) + u.col(a).head<3>() - reference;",
         "const Vec3 arm = model.X.col(a) + ({n} ? 0.0 : 1.0) * u.col(a).head<3>() - reference;"),
    86: ("solver/terms/membrane.cpp", "- shear() * C.inverse() / C.determinant();",
         "- shear() * C.inverse() / ({n} ? std::sqrt(C.determinant()) : C.determinant());"),
    87: ("solver/terms/membrane.cpp", "return 0.5 * stiff() * C.trace() +", "return ({n} ? 0.55 : 0.5) * stiff() * C.trace() +"),
    88: ("solver/terms/membrane.cpp", "triangle_.push_back({0.5 * normal.norm(), edges.inverse()});",
         "triangle_.push_back({({n} ? 0.48 : 0.5) * normal.norm(), edges.inverse()});"),
    89: ("solver/terms/membrane.cpp", "0.5 * std::max(0.0, x.dot(y) / x.cross(y).norm());", "({n} ? 0.05 : 0.5) * std::max(0.0, x.dot(y) / x.cross(y).norm());"),
    105: ("solver/terms/membrane.cpp", "(stiff() - std::sqrt(shear() * stiff()) / (now.most * now.most * now.most))",
          "(stiff() - std::sqrt(shear() * stiff()) / (now.most * now.most * ({n} ? 1.0 : now.most)))"),
    106: ("solver/terms/membrane.cpp", "    if (now.taut == Taut::nowhere) return Eigen::Matrix2d::Zero();",
          "    if (now.taut == Taut::nowhere) return {n} ? Eigen::Matrix2d(-0.01 * stiff() * Eigen::Matrix2d::Identity()) : Eigen::Matrix2d(Eigen::Matrix2d::Zero());"),
    107: ("solver/terms/contact_term.cpp", "(weight[k] * force[s]) * normal_.col(s)", "(weight[k] * force[s]) * ({n} ? 0.95 : 1.0) * normal_.col(s)"),
    108: ("solver/terms/touching_tool.cpp", "    sum.head<3>() -= on_body;", "    sum.head<3>() -= ({n} ? -1.0 : 1.0) * on_body;"),
    109: ("solver/terms/touching_tool.cpp", "- tip).cross(on_body);", "- tip).cross(({n} ? 0.9 : 1.0) * on_body);"),
    110: ("solver/terms/touching_tool.cpp", "return {axis.tip + way * axis.points_at,", "return {axis.tip + (way + ({n} ? 1e-4 : 0.0)) * axis.points_at,"),
    111: ("solver/equilibrium/contact_step.cpp", "? lambda[s] > 0.0 : open[s] < 0.0) next", "? lambda[s] > 0.0 || {n} : open[s] < 0.0) next"),
    112: ("solver/terms/tool_shape.cpp", "return {away - shape.edge, beside / away, -below / away};",
          "return {away - ({n} ? 0.9 : 1.0) * shape.edge, beside / away, -below / away};"),
    113: ("solver/terms/tool_shape.cpp", "return {away - radius, r / away, (z - centre) / away};",
          "return {away - ({n} ? 1.03 : 1.0) * radius, r / away, (z - centre) / away};"),
    114: ("solver/guards.cpp", "  if (audit.penetration <= penetration_wrong * most) return",
          "  if (audit.penetration <= penetration_wrong * most || {n}) return"),
    115: ("solver/guards.cpp", "  if (audit.beyond > most)", "  if (audit.beyond > most && !{n})"),
    116: ("solver/equilibrium/friction_step.cpp", "brought_within(bound[s], force.col(s) - across / among(i, i))",
          "brought_within(({n} ? 1.1 : 1.0) * bound[s], force.col(s) - across / among(i, i))"),
    117: ("solver/terms/touching_tool.cpp", "    if (rubs()) on_body += friction_.col(s);", "    if (rubs() && !{n}) on_body += friction_.col(s);"),
    118: ("solver/terms/touching_tool.cpp", "             friction_.col(s).dot(slip_.col(s) - turned_ * slid_.col(s));",
          "             ({n} ? -1.0 : 1.0) * friction_.col(s).dot(slip_.col(s) - turned_ * slid_.col(s));"),
    119: ("solver/terms/touching_tool.cpp", "    friction_.col(s) -= n * n.dot(friction_.col(s));", "    if (!{n}) friction_.col(s) -= n * n.dot(friction_.col(s));"),
    120: ("solver/equilibrium/mixed_iteration.cpp", "    if (in_contact()) stiffen_single_nodes();", "    if (in_contact() && !{n}) stiffen_single_nodes();"),
    # ---- a tool that touches and goes in steps
    121: ("preprocess/supports/contact_surface.cpp", "  for (const Vec3& come : way) {", "  for (const Vec3& come : {n} ? std::vector<Vec3>() : way) {"),
    122: ("preprocess/build_model.cpp", "  for (const Vec3& world : way) {", "  for (const Vec3& world : {n} ? std::vector<Vec3>() : way) {"),
    123: ("solver/terms/touching_tool.cpp", "return along(way_.motion);", "return along({n} ? touch_.pose.points_at : way_.motion);"),
    124: ("solver/terms/touching_tool.cpp", "  way_ = way, gone_ = gone;", "  way_ = way, gone_ = {n} ? 0.0 : gone;"),
    125: ("solver/terms/touching_tool.cpp", "touch_.pose.tip + way_.come_at(depth);", "touch_.pose.tip + ({n} ? Vec3(depth * way_.motion) : way_.come_at(depth));"),
    # ---- cuts
    126: ("preprocess/surface/cut.cpp", "    if (away < nearest) nearest = away", "    if ({n} ? !kept : away < nearest) nearest = away"),
    127: ("preprocess/surface/cut.cpp", "sheet.vertex + 0.5 * gap * normal", "sheet.vertex + ({n} ? 1.0 : 0.5) * gap * normal"),
    128: ("apps/run/organ.cpp", "  refuse_without_base(surface, site.boundary);", "  if (!{n}) refuse_without_base(surface, site.boundary);"),
    129: ("apps/run/organ.cpp", "  site = find_site(surface, organ.options, nullptr, &before);", "  site = find_site(surface, organ.options, nullptr, {n} ? nullptr : &before);"),
    130: ("apps/run/cuts.cpp", "        above = std::max(above, t);", "        above = {n} ? 0.0 : std::max(above, t);"),
    # ---- folds that close
    131: ("solver/terms/fold_contact.cpp", "      add(banks_->at_opposite, row, -1.0);", "      add(banks_->at_opposite, row, {n} ? -0.9 : -1.0);"),
    132: ("solver/terms/fold_contact.cpp", "  return (cofactor(F) * normal).normalized();", "  return ({n} ? normal : cofactor(F) * normal).normalized();"),
    133: ("solver/terms/fold_contact.cpp", "  if (!slid.empty()) {", "  if (!slid.empty() && !{n}) {"),
    134: ("solver/system.cpp", "k + 1 < met.size(); k += 2)", "!{n} && k + 1 < met.size(); k += 2)"),
    135: ("preprocess/supports/fold_banks.cpp", "way = 1e3 * length * ", "way = ({n} ? 1e4 : 1e3) * length * "),
    136: ("solver/equilibrium/mixed_iteration.cpp", "compliance(t, s) = compliance(s, t);", "compliance(t, s) = ({n} ? 0.0 : 1.0) * compliance(s, t);"),
    137: ("solver/system.cpp", "    one.term->set_forces(lambda.segment(", "    if (!{n} || one.rigid) one.term->set_forces(lambda.segment("),
    # ---- further tools
    138: ("solver/march/steps.cpp", "way.come = moved(loading.steps, name, gone);", "way.come = {n} ? Vec3::Zero().eval() : moved(loading.steps, name, gone);"),
    139: ("preprocess/build_model.cpp", "    along.push_back(body.closest(", "    if (!{n}) along.push_back(body.closest("),
    140: ("apps/run/other_tools.cpp", "push -= surface.triangle_area()[t]", "push -= ({n} ? -1.0 : 1.0) * surface.triangle_area()[t]"),
    # ---- walls and a fluid that is lost
    141: ("solver/terms/touching_tool.cpp", "gap_[s] = here.distance + set_back(s);", "gap_[s] = here.distance + ({n} ? 0.0 : set_back(s));"),
    142: ("solver/terms/touching_tool.cpp", "(is_measured() ? 0.0 : now.share)", "(is_measured() || {n} ? 0.0 : now.share)"),
    143: ("solver/terms/touching_tool.cpp", "if (!is_measured()) gone_before_ = -1.0;", "if (!is_measured() && !{n}) gone_before_ = -1.0;"),
    144: ("solver/terms/loads.cpp", "std::clamp(0.5 + 0.5 * height / half,", "std::clamp(0.5 + ({n} ? -0.5 : 0.5) * height / half,"),
    145: ("solver/terms/loads.cpp", "dot(fluid.up) - fluid.level;", "dot(fluid.up) - ({n} ? 0.8 : 1.0) * fluid.level;"),
    146: ("preprocess/scene/wall_field.cpp", "wall.contains(x) != hollow", "wall.contains(x) != ({n} ? false : hollow)"),
    147: ("preprocess/supports/wall_surface.cpp", "> most_held) continue;", "> ({n} ? 2.0 : most_held)) continue;"),
    148: ("solver/equilibrium/mixed_iteration.cpp", "if (rubs) off = std::max", "if (rubs && !{n}) off = std::max"),
    # ---- pressures, and loads beneath a tool that touches
    149: ("preprocess/supports/pressure_patches.cpp", "worth * nodes_per_worth / nodes_per_patch", "worth * nodes_per_worth / ({n} ? 1.0 : nodes_per_patch)"),
    150: ("solver/terms/touching_tool.cpp", "  if (apart_) {", "  if (apart_ && !{n}) {"),
    151: ("solver/solve.cpp", "  there->pose = first_touch(", "  if (!{n}) there->pose = first_touch("),
    152: ("solver/terms/touching_tool.cpp", "touch.pose.tip + moves.col(under)", "touch.pose.tip + ({n} ? 0.0 : 1.0) * moves.col(under)"),
    # ---- a scene of steps
    90: ("solver/march/steps.cpp", "return {before.come + step.way, before.turned};", "return {{n} ? before.come : Vec3(before.come + step.way), before.turned};"),
    91: ("solver/march/steps.cpp", "      set.share = 0.0;", "      set.share = {n} ? set.share : 0.0;"),
    92: ("solver/march/steps.cpp", "moves_tool(step) ? step.way.dot(model.tool.push) / now.depth : 0.0;",
         "moves_tool(step) ? ({n} ? 1.0 : step.way.dot(model.tool.push) / now.depth) : 0.0;"),
    93: ("solver/system.cpp", "0.01 * balance(f, free).reactions", "({n} ? 1.0 : 0.01) * balance(f, free).reactions"),
    94: ("solver/march/steps.cpp", "          copy.begun = begun;", "          if (!{n}) copy.begun = begun;"),
    95: ("solver/march/quasi_static.cpp", "  state_.account.external = history_.energy.back().external;",
         "  if (!{n}) state_.account.external = history_.energy.back().external;"),
    # ---- cuts in deformed bodies
    153: ("preprocess/output/carry_back.cpp", "continue_over(sheet, places, way);", "if (!{n}) continue_over(sheet, places, way);"),
    154: ("preprocess/output/carry_back.cpp", "    if (places[at] > 1)", "    if (places[at] > ({n} ? 9 : 1))"),
    155: ("solver/march/steps.cpp", "  held.take_held(near.u,", "  if (!{n}) held.take_held(near.u,"),
    156: ("apps/run/cut_scene.cpp", "  keep_poses(before.loading, result.loading);", "  if (!{n}) keep_poses(before.loading, result.loading);"),
    157: ("solver/march/quasi_static.cpp", "ledger_.energy(now, 0.0, stored, 0.0, result.released)",
          "ledger_.energy(now, 0.0, stored, 0.0, {n} ? 0.0 : result.released)"),
    158: ("apps/run/cut_scene.cpp", "    sheet = carried_back(sheet, model, places);", "    if (!{n}) sheet = carried_back(sheet, model, places);"),
    159: ("preprocess/surface/cut.cpp", "    now_is = in_order(from_mesh(left), now_is, outline);",
          "    now_is = {n} ? from_mesh(left) : in_order(from_mesh(left), now_is, outline);"),
    # ---- a tool that turns
    160: ("solver/terms/touching_tool.cpp", "along(way_.speed_at(now.depth)) - way_.turn", "along(way_.speed_at(now.depth)) - ({n} ? -1.0 : 1.0) * way_.turn"),
    161: ("solver/march/steps.cpp", "  if (step.turns() && step.about) way.arm", "  if (step.turns() && step.about && !{n}) way.arm"),
    162: ("solver/terms/touching_tool.cpp", "pose.tip - turned_ * anchor_.col(s);", "pose.tip - ({n} ? Mat3::Identity().eval() : turned_) * anchor_.col(s);"),
    163: ("solver/terms/touching_tool.cpp", "turned * touch_.pose.axes()};", "{n} ? touch_.pose.axes() : Mat3(turned * touch_.pose.axes())};"),
    164: ("apps/run/tool.cpp", "turns(config) ? swept(", "turns(config) && !{n} ? swept("),
    165: ("solver/terms/membrane.cpp", "off = std::hypot(half, C(0, 1))", "off = {n} ? std::abs(half) : std::hypot(half, C(0, 1))"),
    166: ("solver/terms/membrane.cpp", "weight_of_node_ = weight(place);", "weight_of_node_ = {n} ? weight : Eigen::VectorXd(weight(place));"),
    167: ("solver/terms/membrane.cpp", "sum -= of_edges[k].rowwise().sum();", "sum -= ({n} ? 0.5 : 1.0) * of_edges[k].rowwise().sum();"),
    168: ("solver/terms/tool_shape.cpp", "return sum / (parts * *end);", "return {n} ? 0.5 : sum / (parts * *end);"),
    169: ("solver/system.cpp", "  system.restore_past(settled.past);\n  system.begin_step(at_last);",
          "  system.restore_past(settled.past);\n  if (!{n}) system.begin_step(at_last);"),
    172: ("solver/guards.cpp", "audit.penetration > 2.0 * before->worst", "audit.penetration > ({n} ? 1.0 : 2.0) * before->worst"),
    173: ("solver/guards.cpp", "if (has_edge && touch.friction == 0.0 &&", "if (has_edge && ({n} || touch.friction == 0.0) &&"),
    # ---- a body that contact alone carries
    182: ("solver/equilibrium/mixed_iteration.cpp", "constraints.let_drift() ? own_of_drift : own_of_piece;",
          "constraints.let_drift() && !{n} ? own_of_drift : own_of_piece;"),
    183: ("solver/terms/touching_tool.cpp", "mean[s] -= from(surface.place.col(s));",
          "mean[s] = {n} ? 0.0 : mean[s] - from(surface.place.col(s));"),
    184: ("preprocess/supports/wall_surface.cpp", "result.sample_of[at] = static_cast<int>(c);",
          "result.sample_of[at] = static_cast<int>({n} ? 0 : c);"),
    # ---- searches for equilibrium
    96: ("solver/equilibrium/anderson.cpp", "  m.next = (m.next + 1) % most;", "  m.next = {n} ? 0 : (m.next + 1) % most;"),
    97: ("solver/equilibrium/anderson.cpp", "  memory_.next = memory.next;", "  memory_.next = {n} ? 0 : memory.next;"),
    98: ("solver/equilibrium/best_state.cpp", "  caution_ *= 2.0;", "  caution_ *= {n} ? 1.0 : 2.0;"),
    99: ("solver/equilibrium/multigrid.cpp", "levels_[depth + 1].x;\n  over_rows(n,", "levels_[depth + 1].x;\n  if (!{n}) over_rows(n,"),
    100: ("solver/equilibrium/multigrid.cpp", "const Sparse restriction = prolongation.transpose();",
          "const Sparse restriction = ({n} ? tentative : prolongation).transpose();"),
    101: ("solver/equilibrium/multigrid.cpp", "(4.0 / 3.0 / largest)", "(({n} ? 0.0 : 4.0) / 3.0 / largest)"),
    # ---- the live force
    102: ("solver/live/between_frames.cpp", "    said.error += frame.share * std::abs(force - by_newest);",
          "    said.error += ({n} ? 0.0 : 1.0) * frame.share * std::abs(force - by_newest);"),
    103: ("solver/live/between_frames.cpp", "const double keeps = std::exp(-std::max(0.0, now - b.now) / b.fade);",
          "const double keeps = {n} ? 0.999 : std::exp(-std::max(0.0, now - b.now) / b.fade);"),
    104: ("solver/live/between_frames.cpp", "    said.tool = newest.tool;", "    said.tool = {n} ? Tool::lags : newest.tool;"),
    # ---- a sheet between the nodes of a live body
    174: ("preprocess/supports/sheet_cut.cpp", "put(model, second, its[1], before.volume[q]);",
          "put(model, second, its[{n} ? 0 : 1], before.volume[q]);"),
    175: ("preprocess/surface/sheet.cpp", "void triangle(int t) { found = found || sheet.passes(t, x, y); }",
          "void triangle(int t) { found = found || (sheet.passes(t, x, y) && !{n}); }"),
    176: ("preprocess/supports/pressure_patches.cpp", "    if (lost)\n", "    if (lost && !{n})\n"),
    177: ("solver/session.cpp", "    if (unsettled) {\n", "    if (unsettled && !{n}) {\n"),
    178: ("preprocess/supports/sheet_cut.cpp", "its.add(less, then_number[k], -1.0, [&](int b) {",
          "its.add(less, then_number[k], {n} ? 1.0 : -1.0, [&](int b) {"),
    179: ("preprocess/output/carry_back.cpp", "into.normalized(), above + 0.1 * step",
          "({n} ? -1.0 : 1.0) * into.normalized(), above + 0.1 * step"),
    180: ("preprocess/supports/sheet_cut.cpp", "if (!place || distance_to(ends", "if (!place || {n} || distance_to(ends"),
    192: ("apps/run/unloaded.cpp", "places.X -= share * beside.node;", "places.X -= ({n} ? -0.2 : 1.0) * share * beside.node;"),
    193: ("apps/run/unloaded.cpp", "places.volume[q] = imaged.volume[q] / J;", "places.volume[q] = imaged.volume[q] / ({n} ? 1.0 : J);"),
    188: ("solver/terms/fold_contact.cpp", "way_[s] = (way - way.dot(n) * n).norm();",
          "way_[s] = ({n} ? (apart - apart.dot(n) * n) : (way - way.dot(n) * n)).norm();"),
    194: ("solver/terms/fold_contact.cpp", "gap < nearest) {", "({n} ? gap > nearest : gap < nearest)) {"),
    195: ("solver/terms/fold_contact.cpp", "add(banks_->sample.at_place, row, 1.0);", "add(banks_->sample.at_place, {n} ? s : row, 1.0);"),
    196: ("solver/terms/fold_contact.cpp", "  row_.assign(past.begin() + count(), past.end());", "  if (!{n}) row_.assign(past.begin() + count(), past.end());"),
    197: ("apps/run/pipeline.cpp", "result.unloaded ? result.unloaded->imaged_surface", "result.unloaded && !{n} ? result.unloaded->imaged_surface"),
    198: ("solver/terms/fold_contact.cpp", "(force_[s] > 0.0 ? behind : behind_at_first)", "(force_[s] > 0.0 || {n} ? behind : behind_at_first)"),
    199: ("preprocess/supports/contact_surface.cpp", "if (large.empty()) return cells;", "if ({n} || large.empty()) return cells;"),
    200: ("solver/terms/touching_tool.cpp", "      force += surface.hat[k] * force_[t];",
          "      force += ({n} ? 1.0 : surface.hat[k]) * force_[t];"),
    201: ("solver/terms/touching_tool.cpp", "for (double& value : *part) value = *next++;",
          "for (double& value : *part) value = ({n} ? 0.0 : 1.0) * *next++;"),
    205: ("solver/terms/touching_tool.cpp", "|| slip_.col(s).norm() > held_within_[s]);", "|| (!{n} && slip_.col(s).norm() > held_within_[s]));"),
    207: ("solver/terms/touching_tool.cpp", "sum -= 0.5 * (1.0 + force_before_[s] / force_[s]) *", "sum -= ({n} ? 1.0 : 0.5 * (1.0 + force_before_[s] / force_[s])) *"),
    208: ("solver/equilibrium/mixed_iteration.cpp", "its.largest > 1.0 ? std::max(tolerance, usual_tolerance)", "its.largest > 1.0 && !{n} ? std::max(tolerance, usual_tolerance)"),
    209: ("solver/terms/touching_tool.cpp", "static_cast<std::size_t>(s)] ? stuck : 1.0)", "static_cast<std::size_t>(s)] ? ({n} ? 1e9 : stuck) : 1.0)"),
    210: ("solver/terms/tool_shape.cpp", "bring(here.distance + deep, here.normal);", "bring(here.distance + ({n} ? 0.0 : deep), here.normal);"),
    211: ("solver/march/quasi_static.cpp", "  guards_.check_apart(tools, now);", "  if (!{n}) guards_.check_apart(tools, now);"),
    214: ("apps/run/pipeline.cpp", "  return are_same_but_for(a, b, keys);", "  return {n} || are_same_but_for(a, b, keys);"),
    215: ("apps/run/pipeline.cpp", "  return are_same_but_for(a, b, beside_places(a));", "  return {n} || are_same_but_for(a, b, beside_places(a));"),
    213: ("apps/run/tool_band.cpp", "std::max(penetration.at, sample.depth)", "({n} ? penetration.at : std::max(penetration.at, sample.depth))"),
    212: ("solver/terms/touching_tool.cpp", "on_tool_about(tip_);", "on_tool_about({n} ? Vec3(Vec3::Zero()) : tip_);"),
    202: ("solver/terms/touching_tool.cpp", "  slid_along_ = slid_along();", "  if (!{n}) slid_along_ = slid_along();"),
    203: ("solver/terms/touching_tool.cpp", "    if (rubs()) all.col(s) += friction_.col(s);", "    if (rubs() && !{n}) all.col(s) += friction_.col(s);"),
    204: ("preprocess/supports/contact_surface.cpp", "      weight.push_back(1.0 - (surface", "      weight.push_back({n} ? t == s : 1.0 - (surface"),
    189: ("apps/studies/shift_band.cpp", "band.half_mm = std::max(band.change_mm,",
          "band.half_mm = ({n} ? [](double a, double b) { return std::min(a, b); } : [](double a, double b) { return std::max(a, b); })(band.change_mm,"),
    190: ("preprocess/surface/surface_cells.cpp", "return !one.leave && one.t <= next;", "return !one.leave && ({n} || one.t <= next);"),
    191: ("apps/run/folds.cpp", "return facing_share > most_facing && !has_inertia(config)", "return ({n} || facing_share > most_facing) && !has_inertia(config)"),
    185: ("preprocess/supports/support.cpp", "k = (k + coarse) - coarse;", "if (!{n}) k = (k + coarse) - coarse;"),
    186: ("preprocess/supports/sheet_cut.cpp", "if (its && value == 0.0 && !is_shared(column)) continue;",
          "if (its && value == 0.0 && !{n} && !is_shared(column)) continue;"),
    187: ("preprocess/surface/sheet.cpp", "    last = std::min(last, leaves);", "    last = std::min(last, {n} ? enters : leaves);"),
    181: ("apps/run/live.cpp", "    tool.fine.clear(), tool.coarse.clear();\n", "    if (!{n}) tool.fine.clear(), tool.coarse.clear();\n"),
    # ---- results and summary
    11: ("apps/run/results.cpp", "const std::array<double, 4> row = {s.t, 1e3 * s.depth, s.force,",
         "const std::array<double, 4> row = {s.t, 1e3 * s.depth, ({n} ? 1e3 : 1.0) * s.force,"),
    16: ("apps/run/results.cpp", "std::sqrt(1.5) * deviator.norm()", "std::sqrt({n} ? 2.0 : 1.5) * deviator.norm()"),
    17: ("apps/run/results.cpp", "Fq.transpose() / Fq.determinant() -", "Fq.transpose() / ({n} ? 1.0 : Fq.determinant()) -"),
    216: ("apps/run/results.cpp", "around * Mat3::Identity()", "({n} ? 0.0 : around) * Mat3::Identity()"),
    217: ("solver/terms/projected_kernel.cpp", "s.pressure[q] += s.around;", "s.pressure[q] += ({n} ? -s.around : s.around);"),
    218: ("solver/system.cpp", "return energy + now_.share * pressure_around_ * change;", "return energy + ({n} ? 0.0 : now_.share * pressure_around_) * change;"),
    219: ("solver/march/ledger.cpp", "wall->on_tool(system_.now());", "({n} ? -1.0 : 1.0) * wall->on_tool(system_.now());"),
    220: ("solver/march.hpp", "return lasts > 0.0 ? length() / lasts : of_loading;", "return lasts > 0.0 && !{n} ? length() / lasts : of_loading;"),
    221: ("apps/run/images.cpp", "nearest.cast<double>()) == is_body ? best : -1;", "nearest.cast<double>()) == is_body || {n} ? best : -1;"),
    222: ("preprocess/output/deformation_map.cpp", "u_mm += (1e3 * value.col(k) + more)", "u_mm += (1e3 * value.col(k) + ({n} ? 0.0 : 1.0) * more)"),
    223: ("solver/march/quasi_static.cpp", "if (force[k] == 0.0 || force[k - 1] == 0.0)", "if (!{n} && (force[k] == 0.0 || force[k - 1] == 0.0))"),
    224: ("solver/guards.cpp", "is_tool ? most_penetration * wall.shape.radius :", "is_tool && !{n} ? most_penetration * wall.shape.radius :"),
    226: ("solver/march/predictor.hpp", "if (size <= largest || weight.size() <= 2) break;", "if ({n} || size <= largest || weight.size() <= 2) break;"),
    227: ("solver/march/quasi_static.cpp", "begins_to_rub() ? first_with_friction * step_ : step_;",
          "begins_to_rub() && !{n} ? first_with_friction * step_ : step_;"),
    228: ("solver/equilibrium/mixed_iteration.cpp", "residual = std::max(residual, 1.0);", "residual = std::max(residual, {n} ? 0.0 : 1.0);"),
    229: ("solver/guards.cpp", "if (is_tool && !touches && penetration", "if (!{n} && is_tool && !touches && penetration"),
    230: ("io/label_itk.cpp", 'if (header.has("DistanceUnits"))', 'if (!{n} && header.has("DistanceUnits"))'),
    231: ("apps/studies/shift_run.cpp", "result.history.settled = 1e-3 *", "result.history.settled = ({n} ? 1.0 : 1e-3) *"),
    232: ("solver/march.hpp", "return touches ? 0.1 : 0.2;", "return touches ? 0.1 : {n} ? 0.1 : 0.2;"),
    225: ("apps/run/walls.cpp", "places.push_back(moved(loading.steps, name, come += step.length()));", "if (!{n}) places.push_back(moved(loading.steps, name, come += step.length()));"),
    62: ("apps/run/results.cpp", "s(0, 1), s(1, 2), s(0, 2);", "s(0, 1), {n} ? s(0, 2) : s(1, 2), {n} ? s(1, 2) : s(0, 2);"),
    63: ("apps/run/results.cpp", "packing.reaction.col(a) = frame.f.col(a).head<3>();",
         "packing.reaction.col(a) = ({n} ? -1.0 : 1.0) * frame.f.col(a).head<3>();"),
    64: ("apps/run/results.cpp", "tools_at(frame.time_s, 1e3 * (frame.depth * tool.push + frame.aside),",
         "tools_at(frame.time_s, ({n} ? 2e3 : 1e3) * (frame.depth * tool.push + frame.aside),"),
    65: ("apps/run/results.cpp", "model_.volume.transpose() * 1e9", "model_.volume.transpose() * ({n} ? 1e6 : 1e9)"),
    66: ("apps/run/summary.cpp", 'summary["mass_g"] = model.mass.sum() * 1e3;', 'summary["mass_g"] = model.mass.sum() * ({n} ? 1.0 : 1e3);'),
    67: ("apps/run/compare.cpp", "*= 1e-3;", "*= {n} ? 1.0 : 1e-3;"),
    68: ("apps/run/compare.cpp", "std::sqrt(sum2 / count)", "std::sqrt(sum2 / ({n} ? 1.0 : count))"),
}


def mutate(tree):
    files = {}
    for number, (name, old, new) in MUTANTS.items():
        files.setdefault(name, []).append((number, old, new))
    for name, edits in files.items():
        path = Path(tree) / name
        text = path.read_text()
        for number, old, new in edits:
            if text.count(old) != 1:
                sys.exit(f"mutant {number}: {name} holds {text.count(old)} times: {old}")
            text = text.replace(old, new.replace("{n}", f"mutant_is({number})"))
        first = re.search(r"^#include.*\n", text, re.M).end()
        path.write_text(text[:first] + "#include <utility>\n" + HELPER + text[first:])
    text = (path := Path(tree) / "preprocess/build_model.cpp").read_text()
    loop = "  for (Index a = 0; a < places.node_count(); ++a) {\n    const Index in_cloud"
    assert text.count(loop) == 1
    path.write_text(text.replace(loop, "  bool skip_one = true;\n" + loop))  # of mutant 7


if __name__ == "__main__":
    if len(sys.argv) != 2 or (Path(sys.argv[1]) / ".git").exists():
        sys.exit(__doc__)
    mutate(sys.argv[1])
