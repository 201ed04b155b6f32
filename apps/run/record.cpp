#include "apps/run/record.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <nlohmann/json.hpp>

#include "apps/run/checkpoint.hpp"
#include "apps/run/images.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/report.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/view.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Line = RunObserver::Line;

void say(const RecordObserver& observer, const std::string& text) {
  if (observer.line) observer.line(Line::said, text);
}
void doing(const RecordObserver& observer, const std::string& text) {
  if (observer.line) observer.line(Line::doing, text);
}

void detail(const RecordObserver& observer, const std::string& text) {
  if (observer.line) observer.line(Line::detail, text);
}

// What the image's resolution adds to a title of a force. A model without an image has nothing to add.
std::string of_image(double force_N, const Json& image_error) {
  return image_error.contains("half_N")
             ? plus_minus(force_N, image_error["half_N"].get<double>(), "image resolution")
             : "";
}

// The title of a force, with why there is no band, and with what image and material add to it.
std::string headline_of(const std::string& title, double force_N, const std::string& unknown,
                        const Json& image_error, double spread) {
  std::string image = of_image(force_N, image_error);
  if (!unknown.empty() && !image.empty()) image.front() = ';';  // the reason may have commas of its own
  return title + (unknown.empty() ? "" : ", no error estimate: " + unknown) + image +
         (spread > 0.0
              ? from_to(force_N, spread * std::abs(force_N), fmt::format("mu +- {} %", plain(100.0 * spread)))
              : "");
}

// "moved by 1.234 mm at (12.0, -30.0, 45.0) mm, +- 0.010 mm (discretisation)".
std::string displacement_title(const Json& displacement) {
  const auto& place = displacement["place_mm"];
  std::string title =
      fmt::format("moved by {} mm at {}", three_digits(displacement["length_mm"].get<double>()),
                  in_words(Vec3(place[0], place[1], place[2])));
  if (displacement.contains("coarser_nodes"))
    title += fmt::format(", +- {} mm (discretisation)", plain(displacement["half_mm"].get<double>(), 2));
  return title;
}

// Where the time of a run went that has made its own model.
std::vector<std::pair<std::string, double>> times_of(const Result& result, double read_s) {
  double surface_s = 0.0;
  for (const auto& [stage, s] : result.stages.seconds())
    if (stage == "surface" || stage == "close gaps") surface_s += s;
  return {{"reading", read_s + result.read_s},
          {"surface", surface_s},
          {"cloud", std::max(0.0, result.build_s - surface_s)},
          {"supports", result.complete_s}};
}

// What an earlier run of the same image or model, by the same options, has left finished. Throws UsageError:
// it was another run.
Outcome finished_already(const fs::path& folder, const Scene& scene, const std::string& input_key,
                         const RunIdentity& identity, const RecordObserver& observer) {
  Outcome outcome;
  outcome.summary_json = read_file(folder / "summary.json", most_bytes_of_text);
  auto before = option_values_in(folder / "config.resolved.toml");
  const Json summary = Json::parse(outcome.summary_json, nullptr, false);
  // As many as its folds asked for, not somebody.
  const Index for_band = summary.value("model", Json::object()).value("nodes_for_band", Index{0});
  if (!scene.given.nodes && std::to_string(for_band) == before["cloud.nodes"])
    before["cloud.nodes"] = identity.options.at("cloud.nodes");
  require_same_run({summary.value("version", ""), before, summary.value(input_key, "")}, identity);
  std::error_code ignored;
  fs::remove(folder / checkpoint_file, ignored);  // if it was killed between the last file and this
  remove_temporaries_in(folder);
  const Json band = summary.value("band", Json::object());
  const double force = summary.value("force_N", 0.0);
  const std::string unknown = band.value("unknown", "");
  const std::optional<double> half =
      unknown.empty() ? std::optional(band.value("half_N", 0.0)) : std::nullopt;
  const Json largest = summary.value("largest_force", Json());
  const std::string title =
      largest.is_object() ? scene_title(largest.value("force_N", 0.0), largest.value("indentation_mm", 0.0),
                                        largest.value("step", ""), force)
                          : force_title(force, summary.value("indentation_mm", 0.0), half);
  outcome.headline = headline_of(title, force, unknown, summary.value("image_error", Json::object()),
                                 scene.material.mu_spread);
  if (summary.contains("displacement")) outcome.further = displacement_title(summary["displacement"]);
  say(observer, fmt::format("resume   {} holds the finished run: nothing to do", folder.string()));
  return outcome;
}

// What is to be resumed in the folder, if anything. Throws UsageError: it was another run.
std::optional<Checkpoint> resumed_in(const ResultFolder& folder, const RunIdentity& identity) {
  if (!folder.resumable()) return std::nullopt;
  Checkpoint checkpoint = read_checkpoint(folder.path() / checkpoint_file);
  require_same_run(checkpoint.run, identity);
  return checkpoint;
}

// What is wrong with the curve is said before anything is computed.
std::optional<MeasuredCurve> compared_curve(const Scene& scene) {
  const std::string& name = scene.output.compare;
  if (name.empty()) return std::nullopt;
  if (name != paper_word) return read_measured_curve(name);
  return paper_curve();
}

// What differs between a run from an image and one from a model's files.
struct Recording {
  fs::path folder;
  Description options;  ///< of which the folder gets a file
  RunIdentity identity;
  std::optional<Checkpoint> resumed = {};
  std::function<void(Result&)> write_model =
      {};  // nothing is written before the model and the load are accepted
  std::function<Json(const Result&)> summary = {};                    // what it begins with
  std::function<std::vector<std::string>(const Result&)> facts = {};  // for the picture
  std::string subject = {};
  std::vector<std::string> command = {};     // what repeats it; none: its image is in memory alone
  std::optional<MeasuredCurve> beside = {};  // what the force is compared with
  ImageTask images = {};
  double read_s = 0.0;  // before simulate()
  Stopwatch whole = {};
};

ExitCode code_of(const std::exception_ptr& failure) {
  try {
    std::rethrow_exception(failure);
  } catch (const Error& error) {
    return error.code;
  }
}

// Between the march and the disk: frames as they come, and now and then where the march stands.
class Recorder {
 public:
  Recorder(const Case& given, Recording& how, const RecordObserver& observer)
      : given_(given), how_(how), observer_(observer) {
    kept_.run = how.identity;
  }

  RunObserver hooks() {
    return {.line = observer_.line,
            .part = observer_.part,
            .placed = [this](const Discretisation& places, const Scheme& scheme) { compare(places, scheme); },
            .begin = [this](Result& now) { begin(now); },
            .before_cut = [this](Result&) { writer_->finish_frames(); },
            .after_cut = [this](Result& now) { go_on(now); },
            .march = {.frame = [this](const Frame& frame) { write(frame); },
                      .sample = [this](const ForceSample& now, const History& h) { return tell(now, h); },
                      .between_steps = [this](const auto& state) { keep(state); },
                      .retry = [this](const Retry& retry) { tell(retry); }}};
  }

  bool has_begun() const { return writer_.has_value(); }
  /// Until all frames are on the disk. Throws what the last one met.
  void finish_frames() {
    const Stopwatch writing;
    if (writer_) writer_->end_frames();
    finishing_s_ = writing.seconds();
  }
  /// Of the last frame, once it is known. Throws what the stage meets.
  void write_images() {
    if (!images_ || images_->each_frame() || result.history.interrupted) return;
    const Stopwatch writing;
    doing(observer_, "warping images");
    images_->write();
    images_s_ = writing.seconds();
  }
  /// After the march, however it ended.
  Outcome conclude(const std::exception_ptr& failure, const Report& reason);

  Result result;

 private:
  void compare(const Discretisation& places, const Scheme& scheme) {
    require_overlap(how_.images, places);
    kept_.model_sha256 = sha256_of_model(places, scheme);
    if (!given_.model) kept_.run.input_sha256 = result.provenance.at("image_sha256");
    if (how_.resumed && how_.resumed->model_sha256 != kept_.model_sha256)
      throw InputError(
          {.fact = "the model has not come out as it was when the run began",
           .where = "--resume",
           .why = "another build of the program, or another processor, computes a little otherwise",
           .remedy = "start anew with --force, or resume where the run was begun"});
  }

  // Of the present body, from the next frame on.
  void write_of(Result& now, const LabelImage& image) {
    LabelAt label_at;
    std::vector<int> labels;
    for (const LabelMeasure& label : now.labels) labels.push_back(label.value);
    if (!labels.empty()) label_at = label_finder(image, Eigen::Isometry3d::Identity(), labels);
    // A refinement that was stopped has little time to write what it has.
    writer_.emplace(how_.folder, now.model, now.history.interrupted ? tables_alone : wanted_of(given_.scene),
                    label_at, now.loading.further, now.loading.duration(), now.loading.touch);
    show_beside(now.loading);
    if (!now.loading.steps.empty()) writer_->show_over_time();
    if (wanted_of(given_.scene).report)
      slices_ = slices_through(1e3 * (now.model.tool.centre + 0.5 * now.loading.depth * now.model.tool.push),
                               now.model, image);
    if (how_.images.any() && !now.history.interrupted)
      images_.emplace(how_.images, how_.folder, now.model, std::move(labels), now.cut);
  }

  // A step has cut the body: frames go on, of another model.
  void go_on(Result& now) {
    const Stopwatch writing;
    const std::vector<double> times = writer_->frame_time_s();
    write_of(now, now.origin->image);
    writer_->go_on_after_cut(times);
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
    say(observer_,
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

  bool tell(const ForceSample& now, const History& h) {
    if (observer_.progress) {
      const std::string where =
          fmt::format("{}, {}", length_in_words(1e3 * now.depth), force_in_words(now.force));
      observer_.progress(
          now.t / result.loading.duration(),
          result.time == TimeMode::quasi_static
              ? where
              : fmt::format("t {:.2f} s, {}, step {} us", now.t, where, three_digits(1e6 * h.dt_smallest)));
    }
    return stop_asked() == StopReason::none;
  }

  void tell(const Retry& retry) {
    say(observer_, fmt::format("retry    {}, at {:.3f} mm ({}): {}", result.history.retries.size(),
                               1e3 * retry.depth, retry.code, retry.what));
  }

  // Where the run stands is kept now and then, within a hundredth of its time.
  void keep(const std::function<MarchState()>& state) {
    if (since_kept_.seconds() < std::max(0.2, 100.0 * keeping_s_)) return;
    const Stopwatch waiting;
    writer_->finish_frames();  // only what is on the disk can be gone on from
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

  // What there is to say at the end.
  struct End {
    double reached_mm = 0.0, force = 0.0, half = 0.0;  // [mm], [N]; half of the band's width
    double largest = 0.0;                              // [N] at any time, with its sign
    double solve_s = 0.0;
    std::string title, status;
  };
  End end_of(const std::exception_ptr& failure, double solve_s) const;
  std::string ended_by(const Report& stopped, const End& end) const;
  void tell_end(const End& end);
  void tell_of_voxels(const End& end);
  Comparison compare_with_measured();
  void show_walls();
  void show_beside(const Loading& loading);
  void draw_overview(const End& end, const std::optional<Comparison>& comparison);
  bool has_images() const { return images_ && !images_->told().empty(); }
  void tell_of_images();
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
  int sheets_ = 0;  // of cuts, written
  // What the march waits for: frames are packed and written beside it.
  double before_march_s_ = 0.0, writing_s_ = 0.0, keeping_s_ = 0.0, finishing_s_ = 0.0, images_s_ = 0.0;
};

Outcome Recorder::conclude(const std::exception_ptr& failure, const Report& reason) {
  const Scene& scene = given_.scene;
  const History& history = result.history;
  // Stopped before there was anything to keep.
  if (history.interrupted &&
      (history.force.empty() || (result.levels.empty() && writer_->frame_time_s().empty())))
    throw Stopped(stop_asked());
  const double solve_s = result.solve_s - writing_s_;
  const Stopwatch ending;
  if (observer_.part) observer_.part(Part::writing, work_of(scene, result));
  writer_->tables(history, result.band, result.image_error, result.spread);

  const Report stopped = history.interrupted ? Stopped(stop_asked()).report : Report{};
  const End end = end_of(failure, solve_s_before() + solve_s);
  Outcome outcome;
  outcome.interrupted = history.interrupted;
  const Json image = image_error_json(result.image_error);
  outcome.headline = headline_of(end.title, end.force, result.band.unknown, image, result.spread);
  if (history.interrupted) outcome.ended_by = ended_by(stopped, end);
  Description taken = how_.options;  // a run of that file takes these nodes again
  if (result.nodes_for_band > 0)
    put_numbers(taken, "cloud.nodes", {static_cast<double>(result.nodes_for_band)});
  const std::string options = to_toml(taken, result.chosen);
  write_file(how_.folder / "config.resolved.toml", options);

  std::optional<Comparison> comparison;
  Json page;  // but for the summary
  if (!history.force.empty()) {
    tell_end(end);
    if (how_.beside) comparison = compare_with_measured();
    show_walls();
    draw_overview(end, comparison);
    if (wanted_of(scene).report)
      page = writer_->report(history, result.band, result.image_error, comparison, slices_, options,
                             !history.interrupted);
    if (!page.is_null() && !how_.command.empty()) page["command"] = run_again(how_.command, how_.folder);
  }
  tell_of_images();
  const double write_s = writing_s_ + before_march_s_ + finishing_s_ + ending.seconds();
  outcome.times = times_here(solve_s, write_s);
  Json summary = how_.summary(result);
  add_run(summary, scene, result, times_in_all(outcome.times, end.solve_s, write_s), end.status,
          failure               ? code_of(failure)
          : history.interrupted ? ExitCode::interrupted
                                : ExitCode::ok,
          failure               ? &reason
          : history.interrupted ? &stopped
                                : nullptr);
  if (comparison) summary["compare"] = to_json(*comparison);
  if (const Json shown = writer_->shown_surface(); shown["triangles"] > 0) summary["shown_surface"] = shown;
  if (result.followed) outcome.further = displacement_title(summary["displacement"]);
  if (has_images()) summary["images"] = images_->summary();
  outcome.summary_json = as_text(summary);
  if (!page.is_null()) write_report(how_.folder / "report.html", summary, page);
  // The last file: a folder with it is complete. Then there is nothing to go on with.
  write_file(how_.folder / "summary.json", outcome.summary_json);
  if (!failure && !history.interrupted) {
    std::error_code ignored;
    fs::remove(how_.folder / checkpoint_file, ignored);
  }
  if (failure) std::rethrow_exception(failure);
  return outcome;
}

Recorder::End Recorder::end_of(const std::exception_ptr& failure, double solve_s) const {
  const History& history = result.history;
  const Band& band = result.band;
  End end;
  end.solve_s = solve_s;
  end.reached_mm = history.force.empty() ? 0.0 : 1e3 * history.force.back().depth;
  end.force = history.force.empty() ? 0.0 : history.force.back().force;
  end.half = band.known() ? band.half.back() : 0.0;
  end.title = force_title(end.force, end.reached_mm, band.known() ? std::optional(end.half) : std::nullopt);
  if (!history.force.empty()) {
    const LargestForce largest = largest_force(result.loading, history.force);
    end.largest = largest.sample.force;
    if (!result.loading.steps.empty())
      end.title = scene_title(end.largest, 1e3 * largest.sample.depth, largest.step, end.force);
  }
  end.status = failure ? "failed" : history.interrupted ? "interrupted" : "finished";
  return end;
}

std::string Recorder::ended_by(const Report& stopped, const End& end) const {
  const Loading& loading = result.loading;
  const std::string come =
      loading.steps.empty() || result.history.force.empty()
          ? fmt::format("{} of {}", length_in_words(end.reached_mm), length_in_words(given_.scene.depth_mm))
          : fmt::format("{:.4g} s of the {:.4g} s of its steps", result.history.force.back().t,
                        loading.duration());
  return fmt::format(
      "{} at {}, after {:.1f} s; {} [{}]", stopped.fact, come, how_.whole.seconds(),
      result.levels.empty() ? "--resume goes on from there" : "this is the finest cloud so far",
      stopped.code);
}

// How the march went, for the picture and for who wants more than the result.
void Recorder::tell_end(const End& end) {
  const History& history = result.history;
  const Band& band = result.band;
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
    detail(observer_,
           fmt::format("done     {} force evaluations, {:.3f} ms each; residual {} of the reactions, the "
                       "base carries {}",
                       history.evaluations, ms, percent(history.residual), base));
  } else {
    const std::string step = three_digits(1e6 * history.dt_first);
    facts_.push_back(fmt::format(
        "{} steps of {} us (stable {} us), {:.2f} ms each, {:.1f} s: {:.2f} x real time", history.evaluations,
        step, three_digits(1e6 * history.dt_stable_first), ms, end.solve_s, times_real));
    detail(
        observer_,
        fmt::format("done     {} steps of {} us, {:.3f} ms each, {:.2f} x real time; energy error "
                    "{}, the base carries {}",
                    history.evaluations, step, ms, times_real, percent(largest_energy_error(history)), base));
  }
  if (band.known())
    detail(observer_,
           fmt::format("band     {} to {}, +- {}, error of the discretisation alone, estimated from {} and "
                       "{} nodes{}",
                       written.number(end.force - end.half), written(end.force + end.half),
                       percent(end.half / std::abs(end.force)), result.model.node_count(), band.coarse_nodes,
                       band.seconds < 0.05 ? "" : fmt::format(", {:.1f} s more", band.seconds)));
  tell_of_voxels(end);
}

void Recorder::tell_of_voxels(const End& end) {
  const ImageError& image = result.image_error;
  if (!image.known())
    return detail(observer_, "voxels   no error by the image's resolution: " + image.unknown);
  const Written written = force_written(end.force);
  detail(
      observer_,
      fmt::format("voxels   +- {}, +- {}, by the image's resolution: {} by the surface's shape, "
                  "{} by the thickness, with voxels of {} along the push",
                  written(image.half.back()), percent(image.half.back() / std::abs(end.force)),
                  written.number(image.shape), written(image.thickness), length_in_words(1e3 * image.voxel)));
}

Comparison Recorder::compare_with_measured() {
  Comparison comparison =
      dimple::compare(*how_.beside, result.history.force, result.band, result.loading.touch != nullptr);
  write_comparison(how_.folder / "compare.csv", comparison);
  facts_.push_back("compared with " + in_words(comparison));
  say(observer_, "compare  " + in_words(comparison));
  for (const std::string* words : {&comparison.measured.left_out, &comparison.measured.averaged})
    if (!words->empty()) say(observer_, "compare  " + *words);
  return comparison;
}

// Tools as solids, like the one that is measured.
void Recorder::show_beside(const Loading& loading) {
  std::vector<ResultWriter::Rigid> rigid;
  for (const Touch& other : loading.walls) {
    if (!other.is_tool) {
      rigid.push_back({other.name});
      continue;
    }
    const auto come = [steps = loading.steps, rate = loading.rate, name = other.name,
                       motion = other.motion.value_or(Vec3::Zero().eval())](double time_s) {
      return steps.empty() ? Vec3(rate * time_s * motion) : moved_at(time_s, steps, rate, name);
    };
    rigid.push_back({other.name, true, tool_body(other), come});
  }
  writer_->show_beside(std::move(rigid));
}

// Where they stand, for picture and page, and what they bear.
void Recorder::show_walls() {
  writer_->show_walls(gap_to_walls(given_.scene, result.loading));
  for (std::size_t k = 0; k < result.history.walls.size(); ++k) {
    const Touch& rigid = result.loading.walls[k];
    const TouchingTool::Touched& now = result.history.walls[k];
    facts_.push_back(rigid.is_tool ? "tool " + at_the_end_in_words(rigid.name, now)
                                   : (rigid.name == "wall" ? "" : "wall ") + in_words(rigid.name, now));
  }
}

// Who is asked to end has not always the time for a picture.
void Recorder::draw_overview(const End& end, const std::optional<Comparison>& comparison) {
  if (result.history.interrupted) return;
  const std::string ended = end.status == "finished" ? "" : " (" + end.status + ")";
  writer_->overview(result.history, result.band, result.image_error, comparison,
                    fmt::format("{}: {}{}{}", how_.subject, end.title,
                                of_image(end.force, image_error_json(result.image_error)), ended),
                    facts_, result.warnings);
}

void Recorder::tell_of_images() {
  if (!has_images()) return;
  say(observer_, "images   " + images_->told());
  const std::string warning = images_->warning();
  if (warning.empty()) return;
  result.warnings.push_back(warning);
  if (observer_.line) observer_.line(Line::warning, warning);
}

std::vector<std::pair<std::string, double>> Recorder::times_here(double solve_s, double write_s) const {
  auto times = times_of(result, how_.read_s);
  times.emplace_back("solving", solve_s);
  times.emplace_back(result.levels.empty() ? "band" : "coarser clouds", result.band.seconds);
  times.emplace_back("writing", write_s);
  if (images_s_ > 0.0) times.emplace_back("images", images_s_);
  return times;
}

// With those of the runs that this one goes on from.
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

Outcome record(Case given, Recording how, const RecordObserver& observer) {
  if (how.resumed) given.from = &how.resumed->state;
  Recorder recorder(given, how, observer);
  // What there is until then is written before a failure of the march is passed on.
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

}  // namespace

Outcome record_run(const Description& options, const fs::path& folder, Existing existing,
                   const RecordObserver& observer, const LabelImage* image) {
  const Stopwatch whole(observer.waited_s);
  ResultFolder results(folder, existing);
  const Scene scene = resolve(options);
  RunIdentity identity{DIMPLE_VERSION, option_values(options), ""};
  Recording how{.folder = folder,
                .options = options,
                .identity = identity,
                .beside = compared_curve(scene),
                .images = images_asked_for(scene),
                .whole = whole};
  if (existing == Existing::resume && !scene.image.file.empty() &&
      (results.finished() || results.resumable())) {
    identity.input_sha256 = sha256_of_file(scene.image.file);
    if (results.finished()) return finished_already(folder, scene, "image_sha256", identity, observer);
    how.resumed = resumed_in(results, identity);
  }
  how.write_model = [&](Result& result) {
    results.prepare();
    const Wanted wanted = result.history.interrupted ? tables_alone : wanted_of(scene);
    if (wanted.model)
      write_model(folder / "model", result.model, result.model.scheme, result.provenance,
                  result.facing_share);
    if (wanted.label) write_vti(folder / "label.vti", result.image);
  };
  how.summary = [&](const Result& result) { return summary_of_image(scene, result); };
  how.facts = [](const Result& result) {
    const ModelReport& report = result.report;
    const Model& model = result.model;
    return std::vector<std::string>{
        fmt::format("{}; {}; {} integration points", volume_in_words(result.segment.voxel_volume_mm3),
                    nodes_in_words(model.node_count(), report), model.point_count()),
        fmt::format("base: {} nodes, {}", model.base.size(), report.boundary.base_reason),
        result.loading.touch
            ? fmt::format("tool: {}, its tip at first touch at {}, {}", in_words(result.loading.touch->shape),
                          in_words(1e3 * result.loading.touch->pose.tip), report.boundary.circle_reason)
            : fmt::format("circle: {} nodes at {}, {}", report.circle_nodes,
                          in_words(model.tool.centre * 1e3), report.boundary.circle_reason)};
  };
  how.subject = fs::path(name_of_image(scene)).filename().string();
  if (!image) how.command = {"run"};
  return record({.scene = scene, .image = image, .band = scene.band}, std::move(how), observer);
}

void add_explained(Outcome& outcome, const fs::path& folder, double seconds, const std::string& ended_by) {
  if (!ended_by.empty()) {
    outcome.interrupted = true;
    outcome.ended_by = ended_by + "; explain.md has what was compared until then";
  }
  Json summary = Json::parse(outcome.summary_json);
  outcome.times.emplace_back("comparing", seconds);
  Json& parts = summary["parts_wall_s"];
  const double before_s =
      parts.is_object() ? parts.value("comparing", 0.0) : 0.0;  // of a run finished already
  parts["comparing"] = seconds;
  summary["total_wall_s"] = summary["total_wall_s"].get<double>() + seconds - before_s;
  if (outcome.interrupted) end_otherwise(summary, Stopped(stop_asked()));
  outcome.summary_json = as_text(summary);
  amend_report(folder / "report.html", summary, read_file(folder / "explain.svg"));
  write_file(folder / "summary.json", outcome.summary_json);
}

Outcome record_solve(const Description& options, const fs::path& model, const fs::path& folder,
                     Existing existing, const RecordObserver& observer) {
  const Stopwatch whole(observer.waited_s), reading;
  fs::path model_folder = fs::is_directory(model) ? model : model.parent_path();
  if (model_folder.empty()) model_folder = ".";
  ResultFolder results(folder, existing, model_folder);
  const Scene scene = resolve(options);
  check_pairs(scene, Feature::solve);
  Case given{.scene = scene, .model = read_model(model)};
  const ModelFiles& files = *given.model;
  Recording how{
      .folder = folder,
      .options = options,
      .identity = {DIMPLE_VERSION, option_values(options), sha256_of_model(files.places, files.scheme)},
      .beside = compared_curve(scene),
      .images = images_asked_for(scene),
      .read_s = reading.seconds(),
      .whole = whole};
  if (existing == Existing::resume && results.finished())
    return finished_already(folder, scene, "model_sha256", how.identity, observer);
  how.resumed = resumed_in(results, how.identity);
  how.write_model = [&](Result&) {
    results.prepare();
    const fs::path label = model_folder / "label.vti";
    if (wanted_of(scene).label && fs::exists(label) && !fs::equivalent(folder, model_folder))
      write_file(folder / "label.vti", read_file(label));
  };
  how.summary = [&, sha256 = how.identity.input_sha256](const Result&) {
    Json summary;
    summary["made_from"] = files.provenance;
    summary["model_sha256"] = sha256;
    return summary;
  };
  how.facts = [&](const Result&) {
    std::vector<std::string> facts;
    for (const char* key : {"image", "base", "circle"})
      if (const auto found = files.provenance.find(key); found != files.provenance.end())
        facts.push_back(fmt::format("{}: {}", key, found->second));
    return facts;
  };
  how.subject = model.filename().string();
  how.command = {"solve", model.string()};
  given.band = true;  // which then says why there is none
  return record(given, std::move(how), observer);
}

Outcome record_model(const Description& options, const fs::path& folder, Existing existing,
                     const RecordObserver& observer) {
  const Stopwatch whole;
  const Scene scene = resolve(options);
  check_pairs(scene, Feature::model);
  ResultFolder results(folder, existing);
  Result result;
  build_case({.scene = scene}, {.line = observer.line, .part = observer.part}, result);
  stop_if_asked();
  const double before_writing_s = whole.seconds();
  doing(observer, "writing the model");
  results.prepare();
  write_vti(folder / "label.vti", result.image);
  write_model(folder, result.model, result.model.scheme, result.provenance, result.facing_share);
  auto times = times_of(result, 0.0);
  times.emplace_back("writing", whole.seconds() - before_writing_s);
  return {.summary_json = as_text(summary_of_model(scene, result)),
          .headline = fmt::format("{} nodes, {} integration points", result.model.node_count(),
                                  result.model.point_count()),
          .times = std::move(times)};
}

}  // namespace dimple
