#pragma once

#include "apps/commands/command.hpp"

namespace dimple {

// Subcommands, each in a file of its name.
Command add_phantom(CLI::App& app, Invocation& shared);
Command add_info(CLI::App& app, Invocation& shared);
Command add_places(CLI::App& app, Invocation& shared);
Command add_model(CLI::App& app, Invocation& shared);
Command add_solve(CLI::App& app, Invocation& shared);
Command add_run(CLI::App& app, Invocation& shared);
Command add_options(CLI::App& app, Invocation& shared);
Command add_cite(CLI::App& app, Invocation& shared);
Command add_doctor(CLI::App& app, Invocation& shared);
// Commands of the whole program only:
Command add_poke(CLI::App& app, Invocation& shared);
Command add_batch(CLI::App& app, Invocation& shared);
Command add_collect(CLI::App& app, Invocation& shared);
Command add_compare(CLI::App& app, Invocation& shared);
Command add_fit(CLI::App& app, Invocation& shared);
Command add_shift(CLI::App& app, Invocation& shared);
Command add_export(CLI::App& app, Invocation& shared);
Command add_man(CLI::App& app, Invocation& shared);         // man.cpp
Command add_completion(CLI::App& app, Invocation& shared);  // man.cpp

/// Measures the dependence of a run's force on its choices (whole program only).
Outcome explain_run(const Scene& scene, const Invocation& shared, Outcome outcome);

/// Command of the whole program only, listed in the help of both programs.
struct WholeCommand {
  const char *name, *summary;
  const char* group = "Subcommands";
};

namespace whole {
inline constexpr WholeCommand poke = {
    "poke", "a live organ: press the tool into it with the mouse, a script or a haptic device"};
inline constexpr WholeCommand batch = {"batch", "a run for each row of a table, several at once"};
inline constexpr WholeCommand collect = {"collect", "one table and one page of all runs in a folder"};
inline constexpr WholeCommand compare = {"compare",
                                         "compare two finished runs: forces with error bounds, and differing "
                                         "options (for a measured curve use `run --compare`)"};
inline constexpr WholeCommand fit = {"fit",
                                     "the tissue's modulus from a measured force curve, with error bounds"};
inline constexpr WholeCommand shift = {
    "shift", "brain shift after a craniotomy: where the skull is open and fluid is lost"};
inline constexpr WholeCommand export_mesh = {
    "export", "write the scene as a mesh for CalculiX or FEBio; --nodes or --spacing sets its size"};
inline constexpr WholeCommand man = {"man", "print a manual page as roff: dimple man run | man -l -",
                                     "About the program"};
inline constexpr WholeCommand completion = {
    "completion", "print a shell script that completes commands and options", "About the program"};
}  // namespace whole

inline CLI::App* add_to(CLI::App& app, const WholeCommand& command) {
  return app.add_subcommand(command.name, command.summary)->group(command.group);
}

}  // namespace dimple
