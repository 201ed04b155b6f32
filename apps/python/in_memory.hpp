#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {

/// What pydimple.Model is.
struct ModelInMemory {
  /// Places, scheme, and what to_surface() needs: who solves makes the rest, which hangs on the tissues.
  Model model;
  std::map<std::string, int> label_names;
  std::map<std::string, std::string> provenance;
  std::vector<std::string> warnings;
  std::string report_json;
  std::shared_ptr<const Origin> origin;  // by which its force gets a band

  // At the vertices of the surface; made when it is asked for at first.
  const Interpolation& to_surface() const {
    std::call_once(made_, [this] { to_surface_ = surface_interpolation(model); });
    return to_surface_;
  }
  const Interpolation& to_nodes() const {
    std::call_once(made_for_nodes_, [this] { to_nodes_ = node_interpolation(model); });
    return to_nodes_;
  }

 private:
  mutable std::once_flag made_, made_for_nodes_;
  mutable Interpolation to_surface_, to_nodes_;
};
using ModelHolder = std::shared_ptr<ModelInMemory>;

/// What pydimple.Result is.
struct Solved {
  std::vector<ForceSample> force;
  Band band;
  std::vector<std::string> warnings;
  std::string summary_json;
  ModelHolder model;
  std::vector<double> frame_time, frame_depth, frame_u;  // [F], [F], [F x N x 3]
};

/// All of a model, or of a result but for its model, and back to the same bits: what it gives afterwards is
/// what it gave before. Throws InputError: bytes of another version of the program, or damaged ones.
std::vector<std::uint8_t> bytes_of(const ModelInMemory& model);
ModelHolder model_of(const std::vector<std::uint8_t>& bytes);
std::vector<std::uint8_t> bytes_of(const Solved& solved);
std::unique_ptr<Solved> solved_of(const std::vector<std::uint8_t>& bytes, ModelHolder model);

}  // namespace dimple
