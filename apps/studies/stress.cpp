#include "apps/studies/stress.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <thread>

#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/studies/converge.hpp"
#include "io/draw/chart.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "io/label_names.hpp"
#include "io/stop.hpp"
#include "preprocess/phantom.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// One start of the program.
struct Job {
  std::string name;  // of its file in runs/
  std::string says;  // in the progress
  Config config;
  std::optional<StressRun> done;
};

// A map with its runs: a job each for every cell or column of depths, and the finest of every case.
struct Study {
  StressMap map;
  std::vector<Job> cells, finest;
};

struct Cell {
  std::string scheme;
  std::size_t x, y;  // numbers of the axes' values
};

std::string file_name(std::string text) {
  for (char& c : text)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '-' && c != '_') c = '-';
  return text;
}

std::string text_of(const Option& option) {
  if (auto* real = std::get_if<double*>(&option.value)) return fmt::format("{}", **real);
  if (auto* whole = std::get_if<std::int64_t*>(&option.value)) return fmt::format("{}", **whole);
  if (auto* word = std::get_if<std::string*>(&option.value)) return **word;
  if (auto* list = std::get_if<std::vector<double>*>(&option.value))
    return fmt::format("{}", fmt::join(**list, ","));
  return fmt::format("{}", fmt::join(**std::get_if<std::vector<std::string>*>(&option.value), ","));
}

// What differs from the defaults, as arguments of `dimple run IMAGE`.
std::vector<std::string> arguments_of(const Config& config) {
  Config given = config, usual;
  std::vector<std::string> words;
  const auto options = options_of(given), defaults = options_of(usual);
  for (std::size_t k = 0; k < options.size(); ++k)
    if (options[k].key != "image.file" && text_of(options[k]) != text_of(defaults[k])) {
      words.push_back("--set");
      words.push_back(fmt::format("{}={}", options[k].key, text_of(options[k])));
    }
  for (const auto& [label, differing] : config.tissue)
    for (const auto& [key, text] : differing) {
      words.push_back("--set");
      words.push_back(fmt::format("tissue.{}.{}={}", label, key.substr(key.find('.') + 1), text));
    }
  return words;
}

// ---------------------------------------------------------------------------------------------------- one run

// Largest imbalance of the energies up to a depth [m], as a part of the largest work up to there.
double energy_error_until(const std::vector<EnergySample>& energy, double depth) {
  double largest = 0.0, done = 0.0;
  for (const EnergySample& e : energy) {
    if (e.depth > depth * (1.0 + 1e-6)) break;
    largest = std::max(largest, std::abs(e.error()));
    done = std::max(done, std::abs(e.external));
  }
  return done > 0.0 ? largest / done : 0.0;
}

// The points of a frame; its force and energies are known when the march is over.
StressFrame points_of(const Frame& frame, const Model& model) {
  StressFrame result{.depth_mm = 1e3 * frame.depth};
  ForceState forces = frame.forces;  // whose last sweep may have been elsewhere
  forces.stress_sweep(frame.u);
  const auto F = forces.deformation_gradients();
  result.J_min = std::numeric_limits<double>::infinity();
  bool finite = true;
  for (Index q = 0; q < F.cols(); ++q) {
    const double J = Eigen::Map<const Mat3>(F.col(q).data()).determinant();
    finite = finite && std::isfinite(J);
    result.J_min = std::min(result.J_min, J);
    if (J > 0.0) continue;
    ++result.inverted;
    result.inverted_mm3 += 1e9 * model.volume[q];
  }
  if (!finite) result.J_min = std::numeric_limits<double>::quiet_NaN();
  return result;
}

// One case in memory, on one thread. Throws what was refused for the user to mend (UsageError, InputError,
// OutputError), and Stopped.
StressRun run_case(const Config& config, double limit_s) {
  StressRun run;
  Result result;
  const Stopwatch whole;
  bool out_of_time = false;
  RunObserver observer;
  observer.march.frame = [&](const Frame& frame) {
    if (frame.number > 0) run.frames.push_back(points_of(frame, result.model));
  };
  observer.march.sample = [&](const ForceSample&, const History&) {
    out_of_time = whole.seconds() > limit_s;
    return !out_of_time;
  };
  try {
    tbb::task_arena(1).execute([&] { simulate({.config = config}, observer, result); });
    if (out_of_time)
      run.ended = "time-out", run.fact = "stopped by the limit of time";
    else if (result.history.interrupted)
      throw Stopped(stop_asked());
  } catch (const Stopped&) {
    throw;
  } catch (const ModelError& error) {
    run.ended = "no-model", run.fact = error.report.fact;
  } catch (const SolveError& error) {
    run.ended = error.report.code, run.fact = error.report.fact;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    run.ended = "crashed", run.fact = error.what();
  }
  run.nodes = result.model.node_count();
  run.points = result.model.point_count();
  run.retries = static_cast<Index>(result.history.retries.size());
  std::set<std::string> codes;
  for (const Finding& finding : result.findings) codes.insert(finding.report.code);
  run.guards = fmt::format("{}", fmt::join(codes, " "));

  std::vector<double> depths;
  for (const StressFrame& frame : run.frames) depths.push_back(frame.depth_mm);
  const std::vector<double> force = forces_at(result.history.force, depths);
  run.frames.resize(force.size());
  for (std::size_t k = 0; k < force.size(); ++k) {
    run.frames[k].force_N = force[k];
    run.frames[k].energy_error = energy_error_until(result.history.energy, 1e-3 * depths[k]);
  }
  return run;
}

// ------------------------------------------------------------------------------------------- kept on the
// disk

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json();
}

double number(const Json& json) {
  return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>();
}

// What must be the same for a run to be taken again.
Json settings_of(const Job& job, const std::string& program, const std::string& image) {
  return {{"arguments", arguments_of(job.config)}, {"image_sha256", image}, {"program_sha256", program}};
}

void keep(const fs::path& file, const Json& settings, const StressRun& run, double limit_s) {
  Json frames = Json::array();
  for (const StressFrame& f : run.frames)
    frames.push_back({number(f.depth_mm), number(f.force_N), number(f.energy_error), number(f.J_min),
                      f.inverted, number(f.inverted_mm3)});
  Json json = {{"settings", settings}, {"ended", run.ended},     {"fact", run.fact},     {"nodes", run.nodes},
               {"points", run.points}, {"retries", run.retries}, {"guards", run.guards}, {"frames", frames}};
  if (run.ended == "time-out") json["limit_s"] = limit_s;
  write_file(file, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

std::optional<StressRun> kept(const fs::path& file, const Json& settings, double limit_s) {
  if (!fs::exists(file)) return std::nullopt;
  try {
    const Json json = Json::parse(read_file(file));
    if (json.at("settings") != settings) return std::nullopt;
    if (json.contains("limit_s") && json["limit_s"] != limit_s) return std::nullopt;
    StressRun run{.ended = json.at("ended"),
                  .fact = json.at("fact"),
                  .frames = {},
                  .nodes = json.at("nodes"),
                  .points = json.at("points"),
                  .retries = json.at("retries"),
                  .guards = json.at("guards")};
    for (const Json& f : json.at("frames"))
      run.frames.push_back({.depth_mm = number(f.at(0)),
                            .force_N = number(f.at(1)),
                            .energy_error = number(f.at(2)),
                            .J_min = number(f.at(3)),
                            .inverted = f.at(4),
                            .inverted_mm3 = number(f.at(5))});
    return run;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;  // another version's, or spoilt: run again
  }
}

// ----------------------------------------------------------------------------------------------------
// running

// Runs what is not done yet, as many at once as there are threads. False: interrupted.
class Runner {
 public:
  Runner(fs::path folder, double limit_s, std::function<void(const std::string&)> progress)
      : folder_(std::move(folder)),
        limit_s_(limit_s),
        progress_(std::move(progress)),
        program_sha_(sha256_of_file(fs::read_symlink("/proc/self/exe"))) {
    make_folder(folder_);
  }

  void expect(std::size_t more) { expected_ += more; }
  std::size_t expected() const { return expected_; }
  std::size_t started() const { return started_; }

  bool operator()(const std::vector<Job*>& jobs) {
    std::vector<Job*> left;
    for (Job* job : jobs) {
      const std::string& image = job->config.image.file;
      if (!image_sha_.contains(image)) image_sha_[image] = sha256_of_file(image);
      job->done =
          kept(folder_ / (job->name + ".json"), settings_of(*job, program_sha_, image_sha_[image]), limit_s_);
      if (job->done)
        ++finished_;
      else
        left.push_back(job);
    }
    if (left.empty()) return true;
    const auto threads = std::min<std::size_t>(
        tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism), left.size());
    std::atomic<std::size_t> next{0};
    std::atomic<bool> stop{false};
    std::exception_ptr failure;
    const auto work = [&] {
      for (std::size_t k = next++; k < left.size() && !stop; k = next++) try {
          if (!run(*left[k])) stop = true;
        } catch (...) {
          const std::lock_guard lock(mutex_);
          if (!failure) failure = std::current_exception();
          stop = true;
        }
    };
    {
      std::vector<std::jthread> workers;
      for (std::size_t k = 0; k < threads; ++k) workers.emplace_back(work);
    }
    if (failure) std::rethrow_exception(failure);
    return !stop;
  }

 private:
  bool run(Job& job) {
    const Stopwatch running;
    try {
      job.done = run_case(job.config, limit_s_);
    } catch (const Stopped&) {
      return false;
    }
    keep(folder_ / (job.name + ".json"), settings_of(job, program_sha_, image_sha_.at(job.config.image.file)),
         *job.done, limit_s_);
    const std::lock_guard lock(mutex_);
    ++started_;
    ++finished_;
    progress_(fmt::format("{:>4} of {}  {}: {}, {:.1f} s", finished_, expected_, job.says,
                          job.done->ended.empty() ? "finished"
                                                  : fmt::format("{} after {} of {} frames ({})",
                                                                job.done->ended, job.done->frames.size(),
                                                                job.config.solver.frames, job.done->fact),
                          running.seconds()));
    return true;
  }

  fs::path folder_;
  double limit_s_;
  std::function<void(const std::string&)> progress_;
  std::string program_sha_;
  std::map<std::string, std::string> image_sha_;
  std::mutex mutex_;
  std::size_t expected_ = 0, finished_ = 0, started_ = 0;
};

// ------------------------------------------------------------------------------------------------ from a map

std::size_t steps(const StressAxis& axis) {
  return axis.is_depth() ? 1 : axis.values.size();
}

// Frames for each depth of an axis: two at least, so that a bend between depths shows, and sixteen in all, or
// the work that is summed over them is not that of the curve.
std::int64_t frames_a_depth(const StressAxis& axis) {
  const auto count = static_cast<std::int64_t>(axis.values.size());
  return std::max<std::int64_t>(2, (15 + count) / count);
}

std::int64_t last_frame(const StressMap& map, const Config& config, std::size_t x, std::size_t y) {
  if (map.x.is_depth()) return frames_a_depth(map.x) * static_cast<std::int64_t>(x + 1);
  if (map.y.is_depth()) return frames_a_depth(map.y) * static_cast<std::int64_t>(y + 1);
  return config.solver.frames;
}

// The images of the block, one for each height, made when they are first asked for.
class Blocks {
 public:
  explicit Blocks(fs::path folder) : folder_(std::move(folder)) {}
  std::string operator()(const std::array<double, 3>& size_mm) {
    const fs::path file = folder_ / fmt::format("block_{}x{}x{}.nrrd", size_mm[0], size_mm[1], size_mm[2]);
    if (made_.insert(file).second) {
      double spacing = 1.0;
      while (size_mm[2] / spacing < 8.0) spacing /= 2.0;  // as thin as a phantom may be
      write_label_image(file, make_phantom({.shape = "block",
                                            .size_mm = {size_mm[0], size_mm[1], size_mm[2]},
                                            .spacing_mm = spacing}));
    }
    return file.string();
  }

 private:
  fs::path folder_;
  std::set<fs::path> made_;
};

Config config_at(const StressMap& map, const Config& base, const std::string& scheme, std::size_t x,
                 std::size_t y, const std::function<std::string(const std::array<double, 3>&)>& image) {
  Config config = base;
  // What was asked for is stronger than what the map says.
  for (const auto& [key, text] : map.settings)
    if (!base.source.contains(key)) set_option(config, key, text, map.name);
  config.scheme.name = scheme;
  std::array<double, 3> size = map.block_mm;
  for (const auto& [axis, k] : {std::pair{&map.x, x}, {&map.y, y}}) {
    if (axis->is_height()) {
      size[2] = std::stod(axis->values[k]);
    } else if (axis->is_depth()) {
      set_option(config, axis->key, axis->values.back(), map.name);
      config.solver.frames = frames_a_depth(*axis) * static_cast<std::int64_t>(axis->values.size());
    } else {
      set_option(config, axis->key, axis->values[k], map.name);
    }
  }
  if (config.image.file.empty()) config.image.file = image(size);
  return config;
}

// The part of a run's name that the values make; of the physical ones only, if asked so.
std::string place_of(const StressMap& map, std::size_t x, std::size_t y, bool physical_only) {
  std::string text;
  for (const auto& [axis, k] : {std::pair{&map.x, x}, {&map.y, y}})
    if (!axis->is_depth() && (!physical_only || is_physical(axis->key)))
      text += fmt::format("_{}", axis->values[k]);
  return text;
}

Job finest_job(const StressMap& map, const Config& config, std::size_t x, std::size_t y, Index nodes) {
  const std::string place = place_of(map, x, y, true);
  return {.name = file_name(fmt::format("{}_finest{}{}", map.name, nodes, place)),
          .says = fmt::format("{} finest, {} nodes{}", map.name, nodes, place),
          .config = finest_of(config, nodes),
          .done = {}};
}

// ------------------------------------------------------------------------------------------------- the
// result

std::string csv_number(double value, int digits = 6) {
  return std::isfinite(value) ? fmt::format("{:.{}g}", value, digits) : "";
}

std::string quoted(std::string words) {
  std::replace(words.begin(), words.end(), '"', '\'');
  return fmt::format("\"{}\"", words);
}

// Which number says most about a verdict.
std::string note_of(const StressVerdict& v) {
  if (v.code == "ok" || v.code == "inaccurate") return fmt::format("{:+.1f} %", 100.0 * v.error);
  if (v.code == "ok-rim") return fmt::format("{:+.1f} %, {}", 100.0 * v.error, v.inverted);
  if (v.code == "inverted" && v.inverted > 0) return fmt::format("{} points", v.inverted);
  if (v.code == "kinked") return fmt::format("{:.0f} %", 100.0 * v.kink);
  if (v.code == "energy" && v.energy_error > 0.0) return fmt::format("{:.3g} %", 100.0 * v.energy_error);
  return {};
}

// Colours that stay the same from map to map; io/draw/chart gives the greens to "ok...".
const std::map<std::string, int> colours = {
    {"inaccurate", 2}, {"inverted", 0},     {"kinked", 3},    {"unchecked", 4},     {"no-equilibrium", 1},
    {"no-model", 6},   {"time-step", 5},    {"energy", 7},    {"non-finite", 13},   {"time-out", 14},
    {"crashed", 8},    {"conditioning", 9}, {"supports", 10}, {"circle-nodes", 11}, {"hourglass", 12}};

struct Drawn {
  std::string csv;
  std::vector<Map> panels;
  std::vector<std::map<std::string, int>> counts;  // per scheme
};

const Job* find(const std::vector<Job>& jobs, const std::string& name) {
  const auto found = std::find_if(jobs.begin(), jobs.end(), [&](const Job& j) { return j.name == name; });
  return found == jobs.end() || !found->done ? nullptr : &*found;
}

Drawn result_of(const Study& study, const StressOptions& options) {
  const StressMap& map = study.map;
  Drawn result;
  result.csv = fmt::format(
      "scheme,{},{},code,force_N,reference_N,reference_nodes,error_percent,kink_percent,energy_error_percent,"
      "J_min,inverted_points,inverted_mm3,points,nodes,retries,guards,frames,ended,fact,run\n",
      map.x.key, map.y.key);
  const bool has_depth = map.x.is_depth() || map.y.is_depth();
  for (const std::string& scheme : options.schemes) {
    Map panel{.title = fmt::format("{}: {}", map.title, scheme),
              .subtitle = {map.scene},
              .x_label = map.x.label.empty() ? map.x.key : map.x.label,
              .y_label = map.y.label.empty() ? map.y.key : map.y.label,
              .x_ticks = map.x.ticks.empty() ? map.x.values : map.x.ticks,
              .y_ticks = map.y.ticks.empty() ? map.y.values : map.y.ticks};
    std::map<std::string, int> counts;
    for (std::size_t y = 0; y < map.y.values.size(); ++y)
      for (std::size_t x = 0; x < map.x.values.size(); ++x) {
        const Job* job = find(
            study.cells, file_name(fmt::format("{}_{}{}", map.name, scheme, place_of(map, x, y, false))));
        if (!job) {  // interrupted
          panel.cell.emplace_back();
          panel.note.emplace_back();
          continue;
        }
        std::vector<StressRun> finest;
        for (const Index nodes : options.finest)
          if (const Job* fine = find(study.finest, finest_job(map, job->config, x, y, nodes).name))
            finest.push_back(*fine->done);
        const StressRun& run = *job->done;
        const StressVerdict v =
            judge(run, finest, static_cast<std::size_t>(last_frame(map, job->config, x, y)), has_depth,
                  0.5 * job->config.boundary.indenter_diameter_mm);
        panel.cell.push_back(v.code);
        panel.note.push_back(note_of(v));
        panel.legend[v.code] = meaning_of(v.code);
        ++counts[v.code];
        const bool reached = std::isfinite(v.force_N);
        const auto percent = [&](double part) { return reached ? csv_number(100.0 * part, 4) : ""; };
        result.csv += fmt::format(
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", scheme, map.x.values[x],
            map.y.values[y], v.code, csv_number(v.force_N), csv_number(v.reference_N), v.reference_nodes,
            std::isfinite(v.reference_N) ? percent(v.error) : "", percent(v.kink), percent(v.energy_error),
            reached ? csv_number(v.J_min, 4) : "", v.inverted, csv_number(v.inverted_mm3, 4), run.points,
            run.nodes, run.retries, run.guards, run.frames.size(), run.ended.empty() ? "finished" : run.ended,
            quoted(run.fact),
            quoted(fmt::format("dimple run {} -o out {}",
                               fs::path(job->config.image.file).filename().string(),
                               fmt::join(arguments_of(job->config), " "))));
      }
    int alive = 0;
    for (const auto& [code, count] : counts) alive += survived(code) ? count : 0;
    const auto judged =
        std::count_if(panel.cell.begin(), panel.cell.end(), [](const auto& code) { return !code.empty(); });
    if (judged < std::ssize(panel.cell)) panel.legend[""] = "not run yet";
    panel.subtitle.push_back(
        fmt::format("{} of {} cells survive; against the finest stable run of scheme converging ({} nodes)",
                    alive, judged, fmt::join(options.finest, ", else ")));
    panel.colour = colours;
    result.panels.push_back(panel);
    result.counts.push_back(counts);
  }
  return result;
}

std::string counts_text(const std::map<std::string, int>& counts) {
  std::vector<std::string> parts;
  for (const auto& [code, count] : counts) parts.push_back(fmt::format("{} {}", code, count));
  return fmt::format("{}", fmt::join(parts, "; "));
}

// ------------------------------------------------------------------------------------------------ before all

std::vector<StressMap> maps_asked_for(const Config& config, const StressOptions& options) {
  const auto refuse = [](const std::string& fact, const std::string& where, const std::string& why,
                         const std::string& remedy) {
    throw UsageError({.fact = fact, .where = where, .why = why, .remedy = remedy});
  };
  const bool own = !options.x.empty() || !options.y.empty();
  if (own) {
    if (options.x.empty() || options.y.empty())
      refuse("a map of one side", "--x, --y", "it has two",
             "give both, for instance --x material.nu=0.3,0.499 --y cloud.nodes=500,1000");
    if (!options.maps.empty())
      refuse("both a map's name and axes were given", "--map, --x, --y", "a map has two axes",
             "leave --map out, or --x and --y");
    StressMap map{.name = "own",
                  .title = "",
                  .scene = "",
                  .x = stress_axis(options.x, "--x"),
                  .y = stress_axis(options.y, "--y")};
    if (map.x.key == map.y.key)
      refuse(fmt::format("both axes are {}", map.x.key), "--x, --y", "there would be one line of cells",
             "choose two options");
    if (config.image.file.empty()) {
      map.settings = {{"boundary.base", "inferior"}, {"boundary.indent_at", "0,0,top"}};
      map.scene = "block 60 x 60 x 30 mm";
    } else {
      map.scene = fs::path(config.image.file).filename().string();
      for (const StressAxis* axis : {&map.x, &map.y})
        if (axis->is_height())
          refuse("the height of an image cannot be swept", "--x, --y", "phantom.height_mm is about the block",
                 "leave the image out, or choose another option");
    }
    map.title = fmt::format("{} and {}", map.x.key, map.y.key);
    return {map};
  }
  if (!config.image.file.empty())
    refuse("an image was given, but no axes", "command line", "the maps with names are about the block",
           "give --x and --y, for instance --x material.nu=0.3,0.499 --y cloud.nodes=500,1000");
  std::vector<std::string> known;
  for (const StressMap& map : stress_maps()) known.push_back(map.name);
  for (const std::string& name : options.maps)
    if (std::find(known.begin(), known.end(), name) == known.end())
      refuse(fmt::format("there is no map '{}'{}", name, did_you_mean(name, known)), "--map",
             fmt::format("there are {}", fmt::join(known, ", ")), "choose among these, or give --x and --y");
  std::vector<StressMap> maps;
  for (const StressMap& map : stress_maps())
    if (options.maps.empty() ||
        std::find(options.maps.begin(), options.maps.end(), map.name) != options.maps.end())
      maps.push_back(map);
  return maps;
}

void check(const StressOptions& options) {
  const std::vector<std::string> known = {"converging", "horton2007"};
  for (const std::string& scheme : options.schemes)
    if (std::find(known.begin(), known.end(), scheme) == known.end())
      throw UsageError({.fact = fmt::format("'{}' is not known{}", scheme, did_you_mean(scheme, known)),
                        .where = "--schemes",
                        .why = fmt::format("it takes {}", fmt::join(known, ", ")),
                        .remedy = "choose among these"});
  if (options.schemes.empty() || options.finest.empty())
    throw UsageError({.fact = "a map needs a scheme and a finest run to compare with",
                      .where = "--schemes, --finest",
                      .why = "there would be nothing to draw",
                      .remedy = "for instance --schemes converging --finest 4000"});
  for (const Index nodes : options.finest)
    if (nodes < 100)
      throw UsageError({.fact = fmt::format("{} nodes are too few", nodes),
                        .where = "--finest",
                        .why = "a cloud has at least 100",
                        .remedy = "for instance --finest 4000,2000"});
}

}  // namespace

Outcome stress(const Config& given, const StressOptions& options, const fs::path& folder,
               const std::function<void(const std::string&)>& progress) {
  check(options);
  require_no_goal(given, "a study");
  const std::vector<StressMap> maps = maps_asked_for(given, options);
  Config config = given;
  for (std::string* file : {&config.image.file, &config.image.label_names})
    if (!file->empty() && (fs::exists(*file) || !known_label_names(*file))) {
      require_regular_file(*file);  // a file that is not there is refused before the first run
      *file = fs::absolute(*file).string();
    }
  std::error_code error;
  if (fs::is_directory(folder) && !fs::is_empty(folder, error) && !fs::exists(folder / "stress.csv") &&
      !holds_only_a_word(folder))
    throw OutputError(
        {.fact = fmt::format("{} holds files that are not results of dimple stress", folder.string()),
         .where = "-o",
         .why = "they could be overwritten",
         .remedy = "give an empty or a new folder with -o"});
  try_folder(folder);
  make_folder(folder);
  remove_word(folder);
  if (!fs::exists(folder / "stress.csv"))
    write_file(folder / "stress.csv", "map,scheme,cells,survived,codes\n");
  const fs::path whole = fs::absolute(folder);

  Blocks blocks(whole);
  Runner runner(whole / "runs", options.limit_s, progress);
  std::vector<Study> studies;
  for (const StressMap& map : maps) {
    Study study{.map = map, .cells = {}, .finest = {}};
    for (const std::string& scheme : options.schemes)
      for (std::size_t y = 0; y < steps(map.y); ++y)
        for (std::size_t x = 0; x < steps(map.x); ++x) {
          const std::string place = place_of(map, x, y, false);
          study.cells.push_back({.name = file_name(fmt::format("{}_{}{}", map.name, scheme, place)),
                                 .says = fmt::format("{} {}{}", map.name, scheme, place),
                                 .config = config_at(map, config, scheme, x, y, blocks),
                                 .done = {}});
        }
    runner.expect(study.cells.size());
    studies.push_back(std::move(study));
  }

  // The finest runs first, which take longest; the next finest only of cases where one is not stable.
  bool complete = true;
  for (std::size_t level = 0; level < options.finest.size() && complete; ++level) {
    std::vector<Job*> jobs;
    for (Study& study : studies) {
      std::vector<Job> more;
      for (const auto& [x, y] : [&] {
             std::vector<std::pair<std::size_t, std::size_t>> all;
             for (std::size_t j = 0; j < steps(study.map.y); ++j)
               for (std::size_t i = 0; i < steps(study.map.x); ++i) all.emplace_back(i, j);
             return all;
           }()) {
        const Config at = config_at(study.map, config, "converging", x, y, blocks);
        Job job = finest_job(study.map, at, x, y, options.finest[level]);
        const auto same = [&](const Job& other) { return other.name == job.name; };
        if (std::any_of(more.begin(), more.end(), same)) continue;
        if (level > 0) {
          const Job* before =
              find(study.finest, finest_job(study.map, at, x, y, options.finest[level - 1]).name);
          const auto last = static_cast<std::size_t>(at.solver.frames);
          if (before && judge(*before->done, {}, last, true, 0.5 * at.boundary.indenter_diameter_mm).code ==
                            "unchecked")
            continue;
        }
        more.push_back(std::move(job));
      }
      runner.expect(more.size());
      for (Job& job : more) study.finest.push_back(std::move(job));
    }
    for (Study& study : studies)
      for (Job& job : study.finest)
        if (!job.done) jobs.push_back(&job);
    if (level == 0)
      for (Study& study : studies)
        for (Job& job : study.cells) jobs.push_back(&job);
    complete = runner(jobs);
  }

  std::string overview = "map,scheme,cells,survived,codes\n", text;
  Json map_list = Json::array();
  for (const Study& study : studies) {
    const Drawn result = result_of(study, options);
    const std::string name = "stress_" + study.map.name;
    write_file(folder / (name + ".csv"), result.csv);
    write_map_png(folder / (name + ".png"), result.panels, 2);
    write_map_svg(folder / (name + ".svg"), result.panels, 2);
    for (std::size_t k = 0; k < options.schemes.size(); ++k) {
      int alive = 0, cells = 0;
      for (const auto& [code, count] : result.counts[k]) {
        cells += count;
        alive += survived(code) ? count : 0;
      }
      overview += fmt::format("{},{},{},{},{}\n", study.map.name, options.schemes[k], cells, alive,
                              quoted(counts_text(result.counts[k])));
      text += fmt::format("{:<14} {:<11} {:>3} of {:>3} survive: {}\n", study.map.name, options.schemes[k],
                          alive, cells, counts_text(result.counts[k]));
      map_list.push_back(
          {{"map", study.map.name}, {"scheme", options.schemes[k]}, {"cells", cells}, {"survived", alive}});
    }
  }
  write_file(folder / "stress.csv", overview);
  Outcome outcome;
  outcome.headline = fmt::format("{}{} runs, {} of them now", text, runner.expected(), runner.started());
  outcome.summary_json =
      Json({{"runs", runner.expected()}, {"now", runner.started()}, {"maps", map_list}}).dump(2) + "\n";
  outcome.interrupted = !complete;
  if (!complete)
    outcome.ended_by =
        fmt::format("{}; the same command goes on with what is left", Stopped(stop_asked()).report.fact);
  return outcome;
}

}  // namespace dimple
