#include "apps/run/steps.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/table.hpp"
#include "solver/constraints.hpp"
#include "solver/march/steps.hpp"

namespace dimple {
namespace {

constexpr const char* tool_word = "tool";
constexpr double most_turned_deg = 90.0;   // in one step
constexpr double least_turned_deg = 1e-6;  // that is no rounding
// A turning tool is looked at so often; along its axis that is looked at to where it is a radius above its
// first touch, but for so many times that length where it lies flat.
constexpr double looked_at_deg = 5.0, most_of_axis = 4.0;

bool is_of_tool(const Config::Step& step) {
  return step.moves == tool_word;
}

[[noreturn]] void refuse(const std::string& name, const char* key, const std::string& fact,
                         const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fmt::format("the step '{}' {}", name, fact),
                    .where = fmt::format("step.{}.{}", name, key),
                    .why = why,
                    .remedy = remedy});
}

bool all_zero(const std::vector<double>& numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double d) { return d == 0.0; });
}

Vec3 three(const std::vector<double>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

void check_turn(const std::string& name, const Config::Step& step) {
  if (step.turn_deg.empty()) {
    if (!step.about_mm.empty())
      refuse(name, "about_mm", "has a place to turn about, and does not turn",
             "about_mm says where a turn has its middle", "give turn_deg too, or leave about_mm out");
    return;
  }
  if (!is_of_tool(step))
    refuse(name, "turn_deg", fmt::format("turns '{}'", step.moves),
           "only the tool whose force is measured turns; supports and further tools go straight",
           "move it by move_mm, or let the tool turn (moves = \"tool\")");
  if (step.turn_deg.size() != 3)
    refuse(name, "turn_deg", fmt::format("turns by {} numbers", step.turn_deg.size()),
           "a turn is a rotation vector x,y,z in LPS: its direction is the axis, its length the angle",
           "give for instance turn_deg = [0, 20, 0]");
  if (all_zero(step.turn_deg))
    refuse(name, "turn_deg", "turns by nothing", "a step ends where something has come",
           "leave turn_deg out");
  if (const double angle = three(step.turn_deg).norm(); angle > most_turned_deg * (1.0 + 1e-9))
    refuse(name, "turn_deg", fmt::format("turns by {:.4g} degrees", angle),
           fmt::format("a step turns by {:g} degrees at most", most_turned_deg),
           "give it several steps, one after the other");
  if (!step.about_mm.empty() && step.about_mm.size() != 3)
    refuse(name, "about_mm", fmt::format("turns about {} numbers", step.about_mm.size()),
           "a place is x,y,z in LPS", "give for instance about_mm = [0, 0, 40]");
}

void check_way(const Config& config, const std::string& name, const Config::Step& step) {
  const std::size_t count = step.move_mm.size();
  check_turn(name, step);
  if (count == 0 && !step.turn_deg.empty()) return;
  if (count == 0 && step.time_s > 0.0) return;  // a hold
  const bool is_a_tool = is_of_tool(step) || config.other_tool.contains(step.moves);
  const bool along_push = count == 1 && is_a_tool;
  if (count != 3 && !along_push)
    refuse(name, "move_mm", count == 0 ? "moves nothing" : fmt::format("moves by {} numbers", count),
           is_a_tool ? "a tool moves by x,y,z in LPS, or by one number along its push"
                     : "a support moves by x,y,z in LPS",
           "give for instance move_mm = [3, 0, 0], or time_s alone to hold so long");
  if (all_zero(step.move_mm))
    refuse(name, "move_mm", "moves by nothing", "a step ends where something has come",
           "leave move_mm out and give time_s, which holds so long; or leave the step out");
}

// [mm] the deepest that the tool is pushed. Of ways in x, y and z alone, the push not being known yet: along
// the first of them.
double deepest_push(const Config& config) {
  double pushed = 0.0, deepest = 0.0, along_first = 0.0, deepest_along_first = 0.0;
  Vec3 first = Vec3::Zero();
  for (const auto& [name, step] : moving_steps(config)) {
    if (!is_of_tool(step)) continue;
    if (step.move_mm.size() == 1) {
      pushed += step.move_mm[0];
      deepest = std::max(deepest, pushed);
    } else if (step.move_mm.size() == 3) {
      const Vec3 way(step.move_mm[0], step.move_mm[1], step.move_mm[2]);
      if (first.isZero(0.0)) first = way.normalized();
      along_first += way.dot(first);
      deepest_along_first = std::max(deepest_along_first, along_first);
    }
  }
  return deepest > 0.0 ? deepest : deepest_along_first;
}

std::string first_turn(const Config& config) {
  for (const auto& [name, step] : moving_steps(config))
    if (!step.turn_deg.empty()) return name;
  return {};
}

// In a step either something moves or the body is cut.
void check_cut_steps(const Config& config) {
  for (const auto& [name, step] : steps_in_order(config)) {
    if (step.cut.empty()) continue;
    if (!step.move_mm.empty() || !step.turn_deg.empty() || !is_of_tool(step))
      refuse(name, "cut", "cuts and moves something", "a cut is made while all stands still",
             "give it two steps, one after the other");
    if (step.time_s > 0.0)
      refuse(name, "time_s", "cuts, and lasts", "a cut is made in no time",
             "give it a step of its own to hold");
  }
  for (const auto& [name, step] : moving_steps(config))
    if (step.toughness_J_m2 > 0.0)
      refuse(name, "toughness_J_m2", "has a toughness and cuts nothing",
             "it is the energy that a cut's area takes", "give it to a step with a cut");
  if (moving_steps(config).empty())
    refuse(config.step.begin()->first, "cut", "cuts, and no step moves anything",
           "where there are steps they say how the tool moves",
           "add one, as step.press.move = 4mm, or cut the body at rest by --cut");
}

}  // namespace

void check_steps(const Config& config) {
  if (config.step.empty()) return;
  check_cut_steps(config);
  const auto moving = moving_steps(config);
  if (std::all_of(moving.begin(), moving.end(), [](const auto& step) {
        return step.second.move_mm.empty() && step.second.turn_deg.empty() && step.second.time_s > 0.0;
      }))
    refuse(moving.front().first, "time_s", "holds, and no step moves anything",
           "nothing would ever touch or be touched", "press first, as step.press.move_mm = 4");
  double pushed = 0.0;
  for (const auto& [name, step] : moving) {
    if (!is_of_tool(step)) {
      std::vector<std::string> known = {tool_word};
      for (const auto& [support, its] : config.held) known.push_back(support);
      for (const auto& [tool, its] : config.other_tool) known.push_back(tool);
      if (std::find(known.begin() + 1, known.end(), step.moves) == known.end())
        refuse(name, "moves", fmt::format("moves '{}', which is not there", step.moves),
               "it moves the tool, a support or a further tool" + did_you_mean(step.moves, known),
               "give moves = \"tool\", or the NAME of a [support.NAME] or a [tool.NAME]");
    }
    if (config.wall.contains(step.moves))
      refuse(name, "moves", fmt::format("moves '{}', and a wall has that name too", step.moves),
             "a wall stands, and things are moved by their names", "name the wall differently");
    check_way(config, name, step);
    if (is_of_tool(step) && step.move_mm.size() == 1) pushed += step.move_mm[0];
    if (pushed < 0.0 && config.load.contact == "frictionless")
      refuse(name, "move_mm", "lifts the tool above where it touched, and it is frictionless",
             "only a tool that the tissue is bonded to pulls", "lift it less, or give --contact bonded");
  }
  if (turns(config) && deepest_push(config) <= 0.0)
    refuse(first_turn(config), "turn_deg", "turns the tool, and no step presses it in",
           "the nodes are laid for the depth that it is pressed to",
           "press it first, as step.press.move_mm = 2");
}

std::vector<CutStep> cuts_after_moves(const Config& config) {
  std::vector<CutStep> cuts;
  std::size_t moved = 0;
  for (const auto& [name, step] : steps_in_order(config)) {
    if (step.cut.empty())
      ++moved;
    else if (moved > 0)
      cuts.push_back({name, step.cut, moved, step.toughness_J_m2});
  }
  return cuts;
}

namespace {

[[noreturn]] void refuse_poses(const Config& config, const std::string& fact, const std::string& why,
                               const std::string& remedy) {
  throw InputError({.fact = fact,
                    .where = fmt::format("--poses {}", config.load.poses),
                    .why = why,
                    .remedy = remedy,
                    .code = "bad-path"});
}

Eigen::Quaterniond turn_of(const Config& config, const std::array<const std::vector<double>*, 4>& column,
                           std::size_t row) {
  constexpr double of_length_one = 1e-3;
  if (!column[0]) return Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond q((*column[0])[row], (*column[1])[row], (*column[2])[row], (*column[3])[row]);
  if (!(std::abs(q.norm() - 1.0) < of_length_one))
    refuse_poses(config, fmt::format("the quaternion in row {} has the length {:.4g}", row + 1, q.norm()),
                 "a turn is a quaternion of length one", "give qw, qx, qy, qz with w first");
  return q.normalized();
}

// Rows of a tool's poses are steps from each to the next, the first where it first touches.
void take_poses(Config& config) {
  constexpr std::size_t most = 500;
  if (config.load.poses.empty()) return;
  if (!config.step.empty())
    throw UsageError({.fact = "the tool is moved by poses and by steps",
                      .where = "--poses (load.poses)",
                      .why = "poses are steps from each to the next",
                      .remedy = "leave one of the two out"});
  if (was_given(config, "load.rate_mm_per_s"))
    throw UsageError({.fact = "a rate is given, and poses",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "the times of the poses say how fast the tool goes",
                      .remedy = "leave one of the two out"});
  const Table table = read_csv(config.load.poses);
  const auto *time = table.find("time_s"), *x = table.find("x_mm"), *y = table.find("y_mm"),
             *z = table.find("z_mm");
  if (!time || !x || !y || !z)
    refuse_poses(config, "a column of time_s, x_mm, y_mm, z_mm is not there",
                 fmt::format("the columns are named {}", fmt::join(table.header, ", ")),
                 "give these, of the tool's tip in LPS, and qw, qx, qy, qz where it turns");
  const std::array<const std::vector<double>*, 4> turn = {table.find("qw"), table.find("qx"),
                                                          table.find("qy"), table.find("qz")};
  if (std::count(turn.begin(), turn.end(), nullptr) % 4 != 0)
    refuse_poses(config, "a quaternion lacks a column", "it has the four numbers qw, qx, qy, qz",
                 "give all of them, or none");
  if (table.rows() < 2 || table.rows() > most)
    refuse_poses(config, fmt::format("there are {} rows", table.rows()),
                 fmt::format("a way takes two and has {} at most, each a search for equilibria", most),
                 "give where it first touches and where it goes from there");
  bool moves = false;
  for (std::size_t k = 1; k < table.rows(); ++k) {
    if (!((*time)[k] > (*time)[k - 1]))
      refuse_poses(
          config,
          fmt::format("row {} is at {:g} s, the one before at {:g} s", k + 1, (*time)[k], (*time)[k - 1]),
          "time rises along a way", "sort the rows, and leave out those that stand twice");
    Config::Step step;
    step.order = static_cast<int>(k);
    const Vec3 way((*x)[k] - (*x)[k - 1], (*y)[k] - (*y)[k - 1], (*z)[k] - (*z)[k - 1]);
    const Eigen::AngleAxisd by(turn_of(config, turn, k) * turn_of(config, turn, k - 1).conjugate());
    const Vec3 degrees = by.angle() * 180.0 / std::numbers::pi * by.axis();
    if (!way.isZero(0.0)) step.move_mm.assign(way.begin(), way.end());
    if (degrees.norm() > least_turned_deg) step.turn_deg.assign(degrees.begin(), degrees.end());
    step.time_s = (*time)[k] - (*time)[k - 1];
    moves = moves || !step.move_mm.empty() || !step.turn_deg.empty();
    config.step[fmt::format("pose_{:04d}", k + 1)] = step;
  }
  if (!moves)
    refuse_poses(config, "the tool is in one place all the time", "a way goes somewhere", "let it move");
  const double turned = 180.0 / std::numbers::pi * Eigen::AngleAxisd(turn_of(config, turn, 0)).angle();
  config.load.poses_taken = fmt::format(
      "its first row, at {}{}, is where the tool first touches{}; time counts from there",
      in_words(Vec3((*x)[0], (*y)[0], (*z)[0])),
      turned > least_turned_deg ? fmt::format(" and turned by {:.4g} degrees", turned) : "",
      turned > least_turned_deg ? ", and there it stands upright: later rows turn it from that" : "");
  config.load.poses.clear();  // from here on they are steps
}

}  // namespace

void resolve_steps(Config& config) {
  take_poses(config);
  if (config.step.empty()) return;
  double longest = 0.0;
  for (const auto& [name, step] : moving_steps(config)) {
    double length = 0.0;
    for (const double d : step.move_mm) length = std::hypot(length, d);
    longest = std::max(longest, length);
  }
  const double pushed = deepest_push(config), depth = pushed > 0.0 ? pushed : longest;
  if (!(depth > 0.0)) return;  // which check_steps() refuses
  const auto given = config.source.find("load.depth_mm");
  if (given != config.source.end() && given->second != "the steps" &&
      std::abs(config.load.depth_mm - depth) > 1e-9 * depth)
    throw UsageError(
        {.fact = fmt::format("a depth of {} is given, and {}", length_in_words(config.load.depth_mm),
                             config.load.poses_taken.empty() ? "steps" : "poses, which are steps"),
         .where = given->second,
         .why = fmt::format("the steps say how the tool moves: its depth becomes {}", length_in_words(depth)),
         .remedy = "leave the depth out, or the steps"});
  config.load.depth_mm = depth;
  config.source["load.depth_mm"] = "the steps";
}

Vec3 way_of(const std::vector<double>& move, const Vec3& push) {
  return move.size() == 1 ? Vec3(move[0] * push) : Vec3(move[0], move[1], move[2]);
}

std::vector<Step> steps_of(const Config& config, const ToolPlace& tool,
                           const std::map<std::string, Vec3>& push_of_others) {
  const bool relaxing = relaxes(materials_of(config));
  std::vector<Step> steps;
  RigidWay of_tool;
  for (const auto& [name, step] : moving_steps(config)) {
    const auto other = push_of_others.find(step.moves);
    Step& made = steps.emplace_back();
    made.name = name;
    made.moves = is_of_tool(step) ? "" : step.moves;
    made.lasts = step.time_s;
    if (!step.move_mm.empty())
      made.way = 1e-3 * way_of(step.move_mm, other == push_of_others.end() ? tool.push : other->second);
    if (!step.turn_deg.empty()) {
      made.turn = std::numbers::pi / 180.0 * three(step.turn_deg);
      made.lever = std::max(tool_of(config)->radius, 1e-3 * config.load.depth_mm);
    }
    if (made.holds()) made.lever = (relaxing ? 1.0 : 0.1) * tool.radius;  // of ten equilibria, or one
    if (!step.about_mm.empty()) {
      made.about = 1e-3 * three(step.about_mm);
      made.lever = std::max(made.lever, (*made.about - tool.centre - of_tool.come).norm());
    }
    of_tool = after(made, of_tool, tool.centre);
  }
  return steps;
}

void require_near(const std::vector<Step>& steps, const Points& body) {
  constexpr double furthest = 20.0;  // of the body's size
  const double size = (body.rowwise().maxCoeff() - body.rowwise().minCoeff()).norm();
  for (const Step& step : steps)
    if (!step.holds() && step.length() > furthest * size)
      refuse(step.name, step.turns() ? "about_mm" : "move_mm",
             fmt::format("goes {} far, more than {:g} times the body's size of {}",
                         length_in_words(1e3 * step.length()), furthest, length_in_words(1e3 * size)),
             step.turns() ? "a turn about a far place is a long way" : "nothing of the body is there",
             "give lengths and places in mm, LPS, near the body");
}

bool turns(const Config& config) {
  return std::any_of(config.step.begin(), config.step.end(),
                     [](const auto& step) { return !step.second.turn_deg.empty(); });
}

std::vector<Vec3> way_of_tool(const Config& config, const Vec3& push) {
  std::vector<Vec3> way;
  Vec3 come = Vec3::Zero();
  for (const Step& step : steps_of(config, {.push = push}))
    if (step.moves.empty()) way.push_back(come += step.way);
  return way;
}

namespace {

// Where a tool that turns is looked at: at the end of each step, and by and by where it turns. `turned`: it
// has done so, then or before.
template <class Look>
void look_along(const Config& config, const ToolPlace& tool, const Look& look) {
  RigidWay before;
  for (const Step& step : steps_of(config, tool)) {
    if (!step.moves.empty()) continue;
    const RigidWay way = way_in(step, before, tool.centre);
    const double angle = 180.0 / std::numbers::pi * step.turn.norm();
    const int looks = std::max(1, static_cast<int>(std::ceil(angle / looked_at_deg - 1e-9)));
    for (int k = 1; k < looks; ++k) {
      const double s = step.length() * k / looks;
      look(way.come_at(s), way.turned_at(s), way.has_turned());
    }
    before = after(step, before, tool.centre);
    look(before.come, before.turned, way.has_turned());
  }
}

// Of its axis, from the tip to where that is as high as its first touch, or `above` that [m].
double axis_below(const Vec3& come, const Mat3& turned, const Vec3& push, double above) {
  const double high = std::max(0.0, come.dot(push) + above), upright = push.dot(turned * push);
  return high / std::max(upright, 1.0 / most_of_axis);
}

}  // namespace

std::vector<Vec3> swept(const Config& config, const ToolPlace& tool) {
  const ToolShape shape = tool_of(config).value();
  std::vector<Vec3> way;
  look_along(config, tool, [&](const Vec3& come, const Mat3& turned, bool has_turned) {
    way.push_back(come);
    if (!has_turned) return;
    const double up = std::min(axis_below(come, turned, tool.push, shape.radius), shape.length);
    way.push_back(come - up * (turned * tool.push));
  });
  return way;
}

double deepest(const Config& config, const ToolPlace& tool) {
  if (config.step.empty()) return 1e-3 * config.load.depth_mm;
  double most = 0.0;
  if (turns(config)) {
    look_along(config, tool,
               [&](const Vec3& come, const Mat3&, bool) { most = std::max(most, come.dot(tool.push)); });
    return most;
  }
  double depth = 0.0;
  for (const Step& step : steps_of(config, tool))
    if (step.moves.empty()) most = std::max(most, depth += step.way.dot(tool.push));
  return most;
}

double most_of_tool_below(const Config& config, const ToolPlace& tool) {
  if (!turns(config)) return deepest(config, tool);
  double most = 0.0;
  look_along(config, tool, [&](const Vec3& come, const Mat3& turned, bool) {
    most = std::max(most, axis_below(come, turned, tool.push, 0.0));
  });
  return most;
}

std::string in_words(const Step& step) {
  const Vec3 mm = 1e3 * step.way + Vec3::Zero(),
             degrees = 180.0 / std::numbers::pi * step.turn + Vec3::Zero();
  const std::string who = step.moves.empty() ? "the tool" : step.moves;
  const std::string moves = fmt::format("moves by ({:.4g}, {:.4g}, {:.4g}) mm", mm.x(), mm.y(), mm.z());
  const std::string lasts = step.lasts > 0.0 ? fmt::format(", in {:.4g} s", step.lasts) : "";
  if (step.holds()) return fmt::format("{}: all stands for {:.4g} s", step.name, step.lasts);
  if (!step.turns()) return fmt::format("{}: {} {}{}", step.name, who, moves, lasts);
  std::string about = "its tip";
  if (step.about) {
    const Vec3 place = 1e3 * *step.about + Vec3::Zero();
    about = fmt::format("({:.4g}, {:.4g}, {:.4g}) mm", place.x(), place.y(), place.z());
  }
  return fmt::format("{}: {} {}turns by {:.4g} degrees, ({:.4g}, {:.4g}, {:.4g}), about {}{}", step.name, who,
                     step.way.isZero(0.0) ? "" : moves + " and ", degrees.norm(), degrees.x(), degrees.y(),
                     degrees.z(), about, lasts);
}

LargestForce largest_force(const Loading& loading, const std::vector<ForceSample>& force) {
  LargestForce largest{*std::max_element(force.begin(), force.end(),
                                         [](const ForceSample& a, const ForceSample& b) {
                                           return std::abs(a.force) < std::abs(b.force);
                                         }),
                       {}};
  double ended = 0.0;  // [s]
  for (const Step& step : loading.steps) {
    ended += step.seconds(loading.rate);
    largest.step = step.name;
    if (largest.sample.t <= ended * (1.0 + 1e-9)) break;
  }
  return largest;
}

double lateral_force(const ForceSample& sample, const Vec3& push) {
  const Vec3 force(sample.on_tool[0], sample.on_tool[1], sample.on_tool[2]);
  return (force - force.dot(push) * push).norm();
}

}  // namespace dimple
