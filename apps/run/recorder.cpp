#include "apps/run/recorder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <nlohmann/json.hpp>

#include "apps/run/headline.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/report.hpp"
#include "apps/run/results.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/view.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Line = RunObserver::Line;

ExitCode code_of(const std::exception_ptr& failure) {
  try {
    std::rethrow_exception(failure);
  } catch (const Error& error) {
    return error.code;
  }
}

// Writer between the march and the disk: frames as they come, and checkpoints at intervals.
class Recorder {
 public:
  Recorder(const Case& given, Recording& how, const RecordObserver& observer)
      : given_(given), how_(how), observer_(observer) {
    kept_.run = how.identity;
  }

  RunObserver hooks() {
    return {
        .line = observer_.line,
        .part = observer_.part,
        .placed = [this](const Discretisation& places, const Scheme& scheme) { compare(places, scheme); },
        .begin = [this](Result& now) { begin(now); },
        .before_cut = [this](Result&) { writer_->finish_frames(); },
        .after_cut = [this](Result& now) { proceed(now); },
        .march = {.frame = [this](const Frame& frame) { write(frame); },
                  .sample = [this](const ForceSample& now, const History& h) { return report_to(now, h); },
                  .between_steps = [this](const auto& state) { keep(state); },
                  .retry = [this](const Retry& retry) { report_to(retry); }}};
  }

  bool has_begun() const { return writer_.has_value(); }
  /// Waits until all frames are on the disk. Throws the error of the last one.
  void finish_frames() {
    const Stopwatch writing;
    if (writer_) writer_->end_frames();
    finishing_s_ = writing.seconds();
  }
  /// Writes images of the last frame, once it is known. Throws the errors of the writer.
  void write_images() {
    if (!images_ || images_->each_frame() || result.history.interrupted) return;
    const Stopwatch writing;
    observer_.report_to(Line::doing, "warping images");
    images_->write();
    images_s_ = writing.seconds();
  }
  /// Concludes the run after the march, however it ended.
  Outcome conclude(const std::exception_ptr& failure, const Report& reason);

  Result result;

 private:
  void compare(const Discretisation& places, const Scheme& scheme) {
    require_overlap(how_.images, places);
    kept_.model_sha256 = sha256_of_model(places, scheme);
    if (!given_.model) kept_.run.input_sha256 = result.provenance.at("image_sha256");
    if (how_.resumed && how_.resumed->model_sha256 != kept_.model_sha256)
      throw InputError(
          {.fact = "the model differs from that at the start of the run",
           .where = "--resume",
           .why = "another build of the program, or another processor, gives slightly different numbers",
           .remedy = "start again with --force, or resume where the run was begun"});
  }

  // Starts writers for the present body, from the next frame on.
  void write_of(Result& now, const LabelImage& image) {
    LabelAt label_at;
    std::vector<int> labels;
    for (const LabelMeasure& label : now.labels) labels.push_back(label.value);
    if (!labels.empty()) label_at = label_finder(image, Eigen::Isometry3d::Identity(), labels);
    // A stopped refinement has little time to write its results.
    writer_.emplace(how_.folder, now.model,
                    now.history.interrupted ? tables_alone : requested_by(given_.scene), label_at,
                    now.loading.further, now.loading.duration(), now.loading.indenter);
    show_further(now.loading);
    if (!now.loading.steps.empty()) writer_->show_over_time();
    if (requested_by(given_.scene).report)
      slices_ =
          slices_through(1e3 * (now.model.tool.centre + 0.5 * now.loading.depth * now.model.tool.approach),
                         now.model, image);
    if (how_.images.any() && !now.history.interrupted)
      images_.emplace(how_.images, how_.folder, now.model, std::move(labels), now.cut);
  }

  // Continues with frames of another model, after a step has cut the body.
  void proceed(Result& now) {
    const Stopwatch writing;
    const std::vector<double> times = writer_->frame_time_s();
    write_of(now, now.origin->image);
    writer_->continue_after_cut(times);
    if (observer_.after_cut) observer_.after_cut();
    if (!now.cuts.back().sheets.empty()) make_folder(how_.folder / "cuts");
    for (const TriangleMesh& sheet : now.cuts.back().sheets)
      write_vtp(how_.folder / "cuts" / fmt::format("cut_{:04d}.vtp", ++sheets_),
                {.position_mm = sheet.vertex, .triangles = sheet.triangles, .fields = {}},
                now.history.force.back().t);
    writing_s_ += writing.seconds();
  }

  void begin(Result& now) {
    const Stopwatch writing;
    how_.write_model(now);
    before_march_s_ = writing.seconds();
    write_of(now, now.image);
    marching_ = since_kept_ = {};
    if (!how_.resumed) return;
    const Checkpoint& from = *how_.resumed;
    writer_->resume(from.frame_time_s);
    observer_.report_to(
        Line::said,
        fmt::format("resume   after {} frames, at {:.2f} mm", from.frame_time_s.size(),
                    from.state.history.force.empty() ? 0.0 : 1e3 * from.state.history.force.back().depth));
  }

  void write(const Frame& frame) {
    const Stopwatch writing;
    writer_->frame(frame, result.history.carried);
    if (images_) {
      images_->keep(frame);
      if (images_->each_frame()) images_->write();
    }
    writing_s_ += writing.seconds();
    if (observer_.frame) observer_.frame(frame);
  }

  bool report_to(const ForceSample& now, const History& h) {
    if (observer_.progress) {
      const std::string where =
          fmt::format("{}, {}", length_in_words(1e3 * now.depth), force_in_words(now.force));
      observer_.progress(
          now.t / result.loading.duration(),
          result.time == TimeMode::quasi_static
              ? where
              : fmt::format("t {:.2f} s, {}, step {} us", now.t, where, three_digits(1e6 * h.dt_smallest)));
    }
    return stop_requested() == StopReason::none;
  }

  void report_to(const Retry& retry) {
    observer_.report_to(Line::said,
                        fmt::format("retry    {}, at {:.3f} mm ({}): {}", result.history.retries.size(),
                                    1e3 * retry.depth, retry.code, retry.what));
  }

  // Keeps a checkpoint now and then, within a hundredth of the run's time.
  void keep(const std::function<MarchState()>& state) {
    if (since_kept_.seconds() < std::max(0.2, 100.0 * keeping_s_)) return;
    const Stopwatch waiting;
    writer_->finish_frames();  // a run resumes from files on the disk only
    writing_s_ += waiting.seconds();
    const Stopwatch writing;
    kept_.state = state();
    kept_.frame_time_s = writer_->frame_time_s();
    kept_.solve_wall_s = solve_s_before() + marching_.seconds() - writing_s_;
    kept_.write_wall_s = write_s_before() + writing_s_;
    write_checkpoint(how_.folder / checkpoint_file, kept_);
    since_kept_ = {};
    keeping_s_ = writing.seconds();
    writing_s_ += keeping_s_;
  }

  // Values to report at the end.
  struct End {
    double reached_mm = 0.0, force = 0.0, half = 0.0;  // [mm], [N]; half-width of the bounds
    double largest = 0.0;                              // [N] of all times, with its sign
    double solve_s = 0.0;
    std::string title, status = "finished";
    ExitCode code = ExitCode::ok;
    std::optional<Report> reason = {};  // none: it has reached its depth
  };
  End end_of(const std::exception_ptr& failure, const Report& reason, double solve_s) const;
  std::string write_options() const;
  Json page_of(const std::optional<Comparison>& comparison, const std::string& options) const;
  Outcome outcome_of(const End& end) const;
  Json summary_of(const End& end, const RunTimes& times, const std::optional<Comparison>& comparison) const;
  std::string ended_by(const Report& stopped, const End& end) const;
  void report_end(const End& end);
  void report_voxels(const End& end);
  Comparison compare_with_measured();
  void show_walls();
  void show_further(const Loading& loading);
  void draw_overview(const End& end, const std::optional<Comparison>& comparison);
  bool has_images() const { return images_ && !images_->reported().empty(); }
  void report_images();
  std::vector<std::pair<std::string, double>> times_here(double solve_s, double write_s) const;
  RunTimes times_in_all(std::vector<std::pair<std::string, double>> here, double solve_s,
                        double write_s) const;

  double solve_s_before() const { return how_.resumed ? how_.resumed->solve_wall_s : 0.0; }
  double write_s_before() const { return how_.resumed ? how_.resumed->write_wall_s : 0.0; }

  const Case& given_;
  Recording& how_;
  const RecordObserver& observer_;
  Checkpoint kept_;
  std::optional<ResultWriter> writer_;
  std::vector<Slice> slices_;       // for the page
  std::vector<std::string> facts_;  // for the picture
  std::optional<ImageWriter> images_;
  Stopwatch marching_, since_kept_;
  int sheets_ = 0;  // number of cut sheets written
  // Times that the march waits for [s]; packing and writing of frames run in parallel.
  double before_march_s_ = 0.0, writing_s_ = 0.0, keeping_s_ = 0.0, finishing_s_ = 0.0, images_s_ = 0.0;
};

Outcome Recorder::conclude(const std::exception_ptr& failure, const Report& reason) {
  const History& history = result.history;
  // The run was stopped before it had results.
  if (history.interrupted &&
      (history.force.empty() || (result.levels.empty() && writer_->frame_time_s().empty())))
    throw Stopped(stop_requested());
  const double solve_s = result.solve_s - writing_s_;
  const Stopwatch ending;
  if (observer_.part) observer_.part(Part::writing, work_of(given_.scene, result));
  writer_->tables(history, result.error_bounds, result.image_error, result.spread);

  const End end = end_of(failure, reason, solve_s_before() + solve_s);
  Outcome outcome = outcome_of(end);
  const std::string options = write_options();
  std::optional<Comparison> comparison;
  Json page;  // without the summary
  if (!history.force.empty()) {
    report_end(end);
    if (how_.compared) comparison = compare_with_measured();
    show_walls();
    draw_overview(end, comparison);
    page = page_of(comparison, options);
  }
  report_images();
  const double write_s = writing_s_ + before_march_s_ + finishing_s_ + ending.seconds();
  outcome.times = times_here(solve_s, write_s);
  const Json summary = summary_of(end, times_in_all(outcome.times, end.solve_s, write_s), comparison);
  if (result.followed) outcome.further = displacement_title(summary["displacement"]);
  outcome.summary_json = as_text(summary);
  if (!page.is_null()) write_report(how_.folder / "report.html", summary, page);
  // The last file marks the folder as complete. The checkpoint is then removed.
  write_file(how_.folder / "summary.json", outcome.summary_json);
  if (end.code == ExitCode::ok) {
    std::error_code ignored;
    fs::remove(how_.folder / checkpoint_file, ignored);
  }
  if (failure) std::rethrow_exception(failure);
  return outcome;
}

Recorder::End Recorder::end_of(const std::exception_ptr& failure, const Report& reason,
                               double solve_s) const {
  const History& history = result.history;
  const ErrorBounds& error_bounds = result.error_bounds;
  End end;
  end.solve_s = solve_s;
  end.reached_mm = history.force.empty() ? 0.0 : 1e3 * history.force.back().depth;
  end.force = history.force.empty() ? 0.0 : history.force.back().force;
  end.half = error_bounds.known() ? error_bounds.half.back() : 0.0;
  const std::optional<double> half = error_bounds.known() ? std::optional(end.half) : std::nullopt;
  end.title = force_title(end.force, end.reached_mm, half);
  if (!history.force.empty()) {
    const LargestForce largest = largest_force(result.loading, history.force);
    end.largest = largest.sample.force;
    if (!result.loading.steps.empty())
      end.title = scene_title(end.largest, 1e3 * largest.sample.depth, largest.step, end.force, half);
  }
  if (failure) {
    end.status = "failed";
    end.code = code_of(failure);
    end.reason = reason;
  } else if (history.interrupted) {
    end.status = "interrupted";
    end.code = ExitCode::interrupted;
    end.reason = Stopped(stop_requested()).report;
  }
  return end;
}

// Writes the options of the run and the choices for them. A run of that file uses the same nodes.
std::string Recorder::write_options() const {
  Description taken = how_.options;
  if (result.required_nodes > 0)
    put_numbers(taken, "cloud.nodes", {static_cast<double>(result.required_nodes)});
  std::string options = to_toml(taken, result.chosen);
  write_file(how_.folder / "config.resolved.toml", options);
  return options;
}

// Data of report.html in addition to the summary; null: the page is not requested.
Json Recorder::page_of(const std::optional<Comparison>& comparison, const std::string& options) const {
  if (!requested_by(given_.scene).report) return {};
  Json page = writer_->report(result.history, result.error_bounds, result.image_error, comparison, slices_,
                              options, !result.history.interrupted);
  if (!page.is_null() && !how_.command.empty()) page["command"] = run_again(how_.command, how_.folder);
  return page;
}

Outcome Recorder::outcome_of(const End& end) const {
  Outcome outcome;
  outcome.interrupted = result.history.interrupted;
  outcome.headline = headline_of(end.title, end.force, result.error_bounds.unknown,
                                 image_error_json(result.image_error), result.spread);
  if (outcome.interrupted) outcome.ended_by = ended_by(Stopped(stop_requested()).report, end);
  return outcome;
}

Json Recorder::summary_of(const End& end, const RunTimes& times,
                          const std::optional<Comparison>& comparison) const {
  Json summary = how_.summary(result);
  add_run(summary, given_.scene, result, times, end.status, end.code, end.reason ? &*end.reason : nullptr);
  if (comparison) summary["compare"] = to_json(*comparison);
  if (const Json shown = writer_->shown_surface(); shown["triangles"] > 0) summary["shown_surface"] = shown;
  if (has_images()) summary["images"] = images_->summary();
  return summary;
}

std::string Recorder::ended_by(const Report& stopped, const End& end) const {
  const Loading& loading = result.loading;
  const std::string displacement =
      loading.steps.empty() || result.history.force.empty()
          ? fmt::format("{} of {}", length_in_words(end.reached_mm), length_in_words(given_.scene.depth_mm))
          : fmt::format("{:.4g} s of the {:.4g} s of its steps", result.history.force.back().t,
                        loading.duration());
  return fmt::format(
      "{} at {}, after {:.1f} s; {} [{}]", stopped.fact, displacement, how_.whole.seconds(),
      result.levels.empty() ? "--resume continues from there" : "these are the finest nodes so far",
      stopped.code);
}

// Reports the course of the march, for the picture and in detail.
void Recorder::report_end(const End& end) {
  const History& history = result.history;
  const ErrorBounds& error_bounds = result.error_bounds;
  const double evaluations = evaluations_of(history),
               ms = evaluations > 0.0 ? 1e3 * end.solve_s / evaluations : 0.0,
               times_real = end.solve_s > 0.0 ? history.force.back().t / end.solve_s : 0.0;
  const Written written = force_written(end.force == 0.0 ? end.largest : end.force);
  const std::string base = written(history.force.back().base_force);
  facts_ = how_.facts(result);
  for (std::string& line : scene_in_words(given_.scene, result)) facts_.push_back(std::move(line));
  if (result.time == TimeMode::quasi_static) {
    facts_.push_back(
        fmt::format("equilibrium at {} depths: {:.0f} force evaluations, {:.2f} ms each, {:.1f} s",
                    history.force.size() - 1, evaluations, ms, end.solve_s));
    observer_.report_to(Line::detail,
                        fmt::format("done     {} force evaluations, {:.3f} ms each; residual {} of "
                                    "the reactions, force on the base {}",
                                    history.evaluations, ms, percent(history.residual), base));
  } else {
    const std::string step = three_digits(1e6 * history.dt_first);
    facts_.push_back(fmt::format(
        "{} steps of {} us (stable {} us), {:.2f} ms each, {:.1f} s: {:.2f} x real time", history.evaluations,
        step, three_digits(1e6 * history.dt_stable_first), ms, end.solve_s, times_real));
    observer_.report_to(Line::detail, fmt::format("done     {} steps of {} us, {:.3f} ms each, {:.2f} x real "
                                                  "time; energy error {}, force on the base {}",
                                                  history.evaluations, step, ms, times_real,
                                                  percent(largest_energy_error(history)), base));
  }
  if (error_bounds.known())
    observer_.report_to(
        Line::detail,
        fmt::format("bounds   {} to {}, +- {}, discretisation error only, estimated from {} and {} nodes{}",
                    written.number(end.force - end.half), written(end.force + end.half),
                    percent(end.half / std::abs(end.force)), result.model.node_count(),
                    error_bounds.coarse_nodes,
                    error_bounds.seconds < 0.05 ? "" : fmt::format(", {:.1f} s more", error_bounds.seconds)));
  report_voxels(end);
}

void Recorder::report_voxels(const End& end) {
  const ImageError& image = result.image_error;
  if (!image.known())
    return observer_.report_to(Line::detail, "voxels   no error by the image's resolution: " + image.unknown);
  const Written written = force_written(end.force);
  observer_.report_to(
      Line::detail,
      fmt::format("voxels   +- {}, +- {}, by the image's resolution: {} by the surface's shape, {} by the "
                  "thickness, with voxels of {} along the approach direction",
                  written(image.half.back()), percent(image.half.back() / std::abs(end.force)),
                  written.number(image.shape), written(image.thickness), length_in_words(1e3 * image.voxel)));
}

Comparison Recorder::compare_with_measured() {
  Comparison comparison = dimple::compare(*how_.compared, result.history.force, result.error_bounds,
                                          result.loading.indenter != nullptr);
  write_comparison(how_.folder / "compare.csv", comparison);
  facts_.push_back("compared with " + in_words(comparison));
  observer_.report_to(Line::said, "compare  " + in_words(comparison));
  for (const std::string* words : {&comparison.measured.left_out, &comparison.measured.averaged})
    if (!words->empty()) observer_.report_to(Line::said, "compare  " + *words);
  return comparison;
}

// Shows further tools as solids, like the measured one.
void Recorder::show_further(const Loading& loading) {
  std::vector<ResultWriter::Rigid> rigid;
  for (const RigidBody& other : loading.walls) {
    if (!other.is_tool) {
      rigid.push_back({other.name});
      continue;
    }
    const auto displacement = [steps = loading.steps, rate = loading.rate, name = other.name,
                               motion = other.motion.value_or(Vec3::Zero().eval())](double time_s) {
      return steps.empty() ? Vec3(rate * time_s * motion) : moved_at(time_s, steps, rate, name);
    };
    rigid.push_back({other.name, true, tool_body(other), displacement});
  }
  writer_->show_further(std::move(rigid));
}

// Adds the walls to the picture and the page, and reports their forces.
void Recorder::show_walls() {
  writer_->show_walls(gap_to_walls(given_.scene, result.loading));
  for (std::size_t k = 0; k < result.history.walls.size(); ++k) {
    const RigidBody& rigid = result.loading.walls[k];
    const RigidContact::ContactSummary& now = result.history.walls[k];
    facts_.push_back(rigid.is_tool ? "tool " + at_the_end_in_words(rigid.name, now)
                                   : (rigid.name == "wall" ? "" : "wall ") + in_words(rigid.name, now));
  }
}

// A stopped run may have no time for a picture.
void Recorder::draw_overview(const End& end, const std::optional<Comparison>& comparison) {
  if (result.history.interrupted) return;
  const std::string ended = end.status == "finished" ? "" : " (" + end.status + ")";
  writer_->overview(result.history, result.error_bounds, result.image_error, comparison,
                    fmt::format("{}: {}{}{}", how_.subject, end.title,
                                of_image(end.force, image_error_json(result.image_error)), ended),
                    facts_, result.warnings);
}

void Recorder::report_images() {
  if (!has_images()) return;
  observer_.report_to(Line::said, "images   " + images_->reported());
  const std::string warning = images_->warning();
  if (warning.empty()) return;
  result.warnings.push_back(warning);
  if (observer_.line) observer_.line(Line::warning, warning);
}

std::vector<std::pair<std::string, double>> Recorder::times_here(double solve_s, double write_s) const {
  auto times = times_of(result, how_.read_s);
  times.emplace_back("solving", solve_s);
  times.emplace_back(result.levels.empty() ? "band" : "coarser clouds", result.error_bounds.seconds);
  times.emplace_back("writing", write_s);
  if (images_s_ > 0.0) times.emplace_back("images", images_s_);
  return times;
}

// Durations with those of the runs that this one resumes.
RunTimes Recorder::times_in_all(std::vector<std::pair<std::string, double>> here, double solve_s,
                                double write_s) const {
  for (auto& [name, s] : here)
    if (name == "solving")
      s += solve_s_before();
    else if (name == "writing")
      s += write_s_before();
  return {.solve_s = solve_s,
          .write_s = write_s_before() + write_s,
          .total_s = how_.whole.seconds() + solve_s_before() + write_s_before(),
          .parts = std::move(here)};
}

}  // namespace

Outcome record(Case given, Recording how, const RecordObserver& observer) {
  if (how.resumed) given.from = &how.resumed->state;
  Recorder recorder(given, how, observer);
  // The results so far are written before a failure of the march is passed on.
  std::exception_ptr failure;
  Report reason;
  try {
    simulate(given, recorder.hooks(), recorder.result);
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    if (!recorder.has_begun()) throw;
    failure = std::current_exception();
    reason = error.report;
  }
  try {
    recorder.finish_frames();
    if (!failure) recorder.write_images();
  } catch (const Stopped&) {
    recorder.result.history.interrupted = true;
  } catch (const Error& error) {
    if (!failure) failure = std::current_exception(), reason = error.report;
  }
  Outcome outcome = recorder.conclude(failure, reason);
  if (observer.result) observer.result(recorder.result);
  return outcome;
}

}  // namespace dimple
