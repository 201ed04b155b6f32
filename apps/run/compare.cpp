#include "apps/run/compare.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/run/tool.hpp"
#include "io/error.hpp"
#include "io/table.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

// Largest depth [m], the same as in the options.
constexpr double deepest_m = 1.0;

[[noreturn]] void refuse_run(const fs::path& file, const std::string& fact, const std::string& why,
                             const std::string& remedy) {
  throw InputError({.fact = fact, .where = file.string(), .why = why, .remedy = remedy, .code = "bad-curve"});
}

// The column of that quantity in SI units, whose name ends with its unit.
std::vector<double> in_si(const Table& table, const fs::path& file, const std::string& quantity,
                          const std::vector<std::pair<const char*, double>>& units) {
  const std::vector<double>* found = nullptr;
  double factor = 1.0;
  std::string names, first;
  for (const auto& [unit, si] : units) {
    const std::string name = quantity + "_" + unit;
    names += (names.empty() ? "" : ", ") + name;
    const std::vector<double>* column = table.find(name);
    if (!column) continue;
    if (found)
      refuse_run(file, fmt::format("there are two columns of one quantity, {} and {}", first, name),
                 "one of them would be ignored", "leave one of them out");
    found = column, factor = si, first = name;
  }
  if (!found)
    refuse_run(
        file, fmt::format("there is no column {}_{}", quantity, units.front().first),
        fmt::format("the columns are named {}, and a unit is not guessed", fmt::join(table.header, ", ")),
        fmt::format("name it one of {}, and convert the numbers where they are in other units", names));
  std::vector<double> values = *found;
  for (double& value : values) value *= factor;
  return values;
}

// Averages groups of successive rows; the last row stays.
void average(MeasuredCurve& curve) {
  const std::size_t rows = curve.depth.size();
  if (rows <= most_rows_of_curve) return;
  const std::size_t group = (rows - 1 + most_rows_of_curve - 2) / (most_rows_of_curve - 1);
  const auto means = [&](std::vector<double>& list) {
    std::vector<double> result;
    for (std::size_t from = 0; from + 1 < list.size(); from += group) {
      const std::size_t to = std::min(from + group, list.size() - 1);
      double sum = 0.0;
      for (std::size_t k = from; k < to; ++k) sum += list[k];
      result.push_back(sum / static_cast<double>(to - from));
    }
    if (!list.empty()) result.push_back(list.back());
    list = std::move(result);
  };
  means(curve.depth);
  means(curve.force);
  means(curve.time);
  curve.averaged = fmt::format("the curve has {} rows: means of {} successive rows are used, {} in all", rows,
                               group, curve.depth.size());
}

// The rows of one loading; depth [m], force [N], time [s] or none.
MeasuredCurve loading_in(const fs::path& file, const std::vector<double>& depth,
                         const std::vector<double>& force, const std::vector<double>& time) {
  const auto deepest = std::max_element(depth.begin(), depth.end());
  if (deepest == depth.end() || !(*deepest > 0.0))
    refuse_run(file, "no row has an indentation above 0", "a curve needs forces at depths",
               "count the indentation from the first contact, positive into the tissue");
  if (*deepest > deepest_m)
    refuse_run(file, fmt::format("the curve is {:g} mm deep", 1e3 * *deepest), "no organ is",
               "give the indentation in the unit of its column");
  MeasuredCurve curve{.name = file.filename().string()};
  const auto last = static_cast<std::size_t>(deepest - depth.begin());
  for (std::size_t k = 0; k <= last; ++k) {
    if (!(depth[k] > 0.0)) {
      if (curve.depth.empty()) continue;  // before contact
      refuse_run(file, fmt::format("row {} is at {:g} mm, after deeper ones", k + 1, 1e3 * depth[k]),
                 "a curve is one loading: its depths rise",
                 "cut the file before that row, and keep one cycle of loading");
    }
    if (!curve.depth.empty() && !(depth[k] > curve.depth.back()))
      refuse_run(file,
                 fmt::format("row {} is at {:g} mm, the one before at {:g} mm, and deeper ones follow", k + 1,
                             1e3 * depth[k], 1e3 * curve.depth.back()),
                 "a curve is one loading: its depths rise",
                 "keep one cycle of loading; where the sensor's noise does it, average over rows");
    curve.depth.push_back(depth[k]);
    curve.force.push_back(force[k]);
    if (!time.empty()) curve.time.push_back(time[k]);
  }
  if (const std::size_t after = depth.size() - last - 1; after > 0)
    curve.left_out =
        fmt::format("{} of {} rows, after the largest depth of {:g} mm, are left out: they are not loading",
                    after, depth.size(), 1e3 * *deepest);
  double sum = 0.0;
  for (const double f : curve.force) sum += f;
  if (!(sum > 0.0))
    refuse_run(
        file, fmt::format("the forces of the {} rows with a depth add up to {:g} N", curve.force.size(), sum),
        "tissue resists the tool: its force is positive",
        curve.left_out.empty() ? "reverse the sign of the force if the sensor has the opposite sign"
                               : "reverse the sign of the force, or sort the rows in the order of loading");
  average(curve);
  return curve;
}

}  // namespace

std::vector<MeasuredCurve> read_measured_curves(const fs::path& file) {
  const Table table = read_csv(file);
  const std::vector<double> depth = in_si(table, file, "indentation", {{"mm", 1e-3}, {"um", 1e-6}});
  const std::vector<double> force =
      in_si(table, file, "force", {{"N", 1.0}, {"mN", 1e-3}, {"uN", 1e-6}, {"nN", 1e-9}});
  const auto *time = table.find("time_s"), *sample = table.find("sample");
  std::vector<MeasuredCurve> curves;
  std::size_t from = 0, to = 0;
  do {  // without a row, one empty curve, which is refused
    while (to < depth.size() && (!sample || (*sample)[to] == (*sample)[from])) ++to;
    const auto rows = [&](const std::vector<double>& all) {
      return std::vector(all.data() + from, all.data() + to);
    };
    fs::path name = file;
    if (sample && to > from) name += fmt::format(", sample {:g}", (*sample)[from]);
    curves.push_back(loading_in(name, rows(depth), rows(force), time ? rows(*time) : std::vector<double>()));
    if (sample && to > from) curves.back().sample = (*sample)[from];
    from = to;
  } while (to < depth.size());
  return curves;
}

MeasuredCurve read_measured_curve(const fs::path& file) {
  std::vector<MeasuredCurve> curves = read_measured_curves(file);
  if (curves.size() != 1)
    refuse_run(file, fmt::format("the file holds {} curves", curves.size()), "one is compared with one run",
               "keep the rows of one sample");
  return std::move(curves.front());
}

double ramp_rate(const MeasuredCurve& curve) {
  const auto refused = [&](const std::string& fact, const std::string& why) {
    refuse_run(
        curve.name, fact, why,
        "give the part with a constant speed, or leave time_s out where time plays no part in the fit");
  };
  if (curve.time.empty())
    refused("there is no column time_s", "relaxation cannot be fitted from depths alone");
  for (std::size_t k = 1; k < curve.time.size(); ++k)
    if (!(curve.time[k] > curve.time[k - 1]))
      refused(fmt::format("the time does not rise: {:g} s after {:g} s", curve.time[k], curve.time[k - 1]),
              "each row is one moment of a loading");
  if (curve.time.size() < 2) refused("there is one row with a depth", "a speed needs two");
  // The clock may start before contact: depth = rate (t - t0), by least squares.
  const auto n = static_cast<double>(curve.time.size());
  double t_mean = 0.0, d_mean = 0.0, tt = 0.0, td = 0.0;
  for (std::size_t k = 0; k < curve.time.size(); ++k)
    t_mean += curve.time[k] / n, d_mean += curve.depth[k] / n;
  for (std::size_t k = 0; k < curve.time.size(); ++k) {
    tt += (curve.time[k] - t_mean) * (curve.time[k] - t_mean);
    td += (curve.time[k] - t_mean) * (curve.depth[k] - d_mean);
  }
  const double rate = td / tt;
  for (std::size_t k = 0; k < curve.time.size(); ++k) {
    const double off = curve.depth[k] - d_mean - rate * (curve.time[k] - t_mean);
    if (std::abs(off) > 0.05 * curve.depth.back())
      refused(fmt::format(
                  "at {:g} s the tool is {:.2g} mm from where a constant speed of {:.3g} mm/s would have it",
                  curve.time[k], 1e3 * std::abs(off), 1e3 * rate),
              fmt::format("the tool moves at one speed here, and that is more than 5 % of the {:g} mm in all",
                          1e3 * curve.depth.back()));
  }
  return rate;
}

MeasuredCurve paper_curve() {
  // Horton, Wittek, Miller 2007, section 5: one swine brain, a patch of 10 mm, at 1 mm/s.
  return {.name = paper_word,
          .depth = {8e-3, 8e-3, 8e-3},
          .force = {0.181, 0.125, 0.131},
          .time = {},
          .row_name = {"left hemisphere", "right hemisphere", "their simulation"},
          .simulated = 1,
          .left_out = {}};
}

Comparison compare(const MeasuredCurve& measured, const std::vector<ForceSample>& ours,
                   const ErrorBounds& error_bounds, bool has_contact) {
  Comparison result;
  MeasuredCurve& kept = result.measured;
  kept.name = measured.name;
  kept.left_out = measured.left_out;
  kept.averaged = measured.averaged;
  kept.simulated = measured.simulated;
  const double reached = ours.empty() ? 0.0 : ours.back().depth;
  for (std::size_t k = 0; k < measured.depth.size(); ++k) {
    if (measured.depth[k] > reached * (1.0 + 1e-6)) {
      ++result.deeper;
      continue;
    }
    kept.depth.push_back(measured.depth[k]);
    kept.force.push_back(measured.force[k]);
    if (!measured.row_name.empty()) kept.row_name.push_back(measured.row_name[k]);
  }
  if (kept.depth.empty()) return result;
  result.force = has_contact ? contact_forces(ours, kept.depth) : forces_between(ours, kept.depth);
  if (error_bounds.known()) result.half = halves_between(ours, error_bounds.half, kept.depth);
  result.contacting = has_contact;
  const std::size_t rows = kept.depth.size() - kept.simulated;
  double sum = 0.0, sum_ours = 0.0, sum2 = 0.0, inside = 0.0, end = 0.0, at_end = 0.0;
  for (std::size_t k = 0; k < rows; ++k) {
    const double off = kept.force[k] - result.force[k];
    sum += kept.force[k];
    sum_ours += result.force[k];
    sum2 += off * off;
    if (!result.half.empty() && std::abs(off) <= result.half[k]) inside += 1.0;
    if (kept.depth[k] == kept.depth[rows - 1]) at_end += kept.force[k] / result.force[k], end += 1.0;
  }
  const auto count = static_cast<double>(rows);
  result.at_end = at_end / end;
  result.mean = sum / sum_ours;
  result.rms = std::sqrt(sum2 / count);
  if (!result.half.empty()) result.inside_error_bounds = inside / count;
  return result;
}

std::string in_words(const Comparison& c) {
  const MeasuredCurve& m = c.measured;
  std::string text = m.name + ": ";
  if (c.force.empty()) {
    text += "nothing to compare";
  } else if (!m.row_name.empty()) {
    std::vector<std::string> rows;
    for (std::size_t k = 0; k < m.row_name.size(); ++k)
      rows.push_back(fmt::format("{} {:.2f}", m.row_name[k], m.force[k] / c.force[k]));
    text += fmt::format("theirs / ours at {:.2f} mm: {}", 1e3 * m.depth.back(), fmt::join(rows, ", "));
  } else {
    text += fmt::format("measured / ours {:.2f} at {:.2f} mm, {:.2f} on average over {} depths", c.at_end,
                        1e3 * m.depth.back(), c.mean, m.depth.size());
    if (c.inside_error_bounds)
      text += fmt::format(", {:.0f} % of them within the error bounds", 100.0 * *c.inside_error_bounds);
  }
  if (c.deeper > 0)
    text += fmt::format("; {} row{} deeper than this run {} not compared", c.deeper, c.deeper == 1 ? "" : "s",
                        c.deeper == 1 ? "is" : "are");
  return text;
}

nlohmann::ordered_json to_json(const Comparison& c) {
  using Json = nlohmann::ordered_json;
  const bool some = !c.force.empty();
  Json json = {{"file", c.measured.name},
               {"rows", c.measured.depth.size()},
               {"deeper_rows", c.deeper},
               {"depth_mm", some ? Json(1e3 * c.measured.depth.back()) : Json()},
               {"ratio_at_end", some ? Json(c.at_end) : Json()},
               {"mean_ratio", some ? Json(c.mean) : Json()},
               {"rms_N", some ? Json(c.rms) : Json()},
               {"inside_band", c.inside_error_bounds ? Json(*c.inside_error_bounds) : Json()}};
  for (std::size_t k = 0; k < c.measured.row_name.size(); ++k)
    json["values"].push_back({{"name", c.measured.row_name[k]},
                              {"force_N", c.measured.force[k]},
                              {"ratio", c.measured.force[k] / c.force[k]}});
  return json;
}

void write_comparison(const fs::path& file, const Comparison& c) {
  Table table{.header = {"indentation_mm", "measured_N", "force_N"},
              .column = std::vector<std::vector<double>>(3)};
  for (std::size_t k = 0; k < c.force.size(); ++k) {
    table.column[0].push_back(1e3 * c.measured.depth[k]);
    table.column[1].push_back(c.measured.force[k]);
    table.column[2].push_back(c.force[k]);
  }
  if (!c.half.empty()) {
    table.header.insert(table.header.end(), {"low_N", "high_N"});
    table.column.resize(5);
    for (std::size_t k = 0; k < c.force.size(); ++k) {
      table.column[3].push_back(lower_bound(c.force[k], c.half[k], c.contacting));
      table.column[4].push_back(c.force[k] + c.half[k]);
    }
  }
  write_csv(file, table);
}

}  // namespace dimple
