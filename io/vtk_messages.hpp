#pragma once

#include <memory>
#include <string>

namespace dimple {

/// Captures what VTK says of files for as long as it lives, and restores the former window afterwards. VTK's
/// logger, which writes to the terminal as well, is silenced. Used by vtk_files.cpp and vtk_read.cpp.
class MessageScope {
 public:
  MessageScope();
  ~MessageScope();
  MessageScope(const MessageScope&) = delete;
  MessageScope& operator=(const MessageScope&) = delete;

  /// The first message in one line, without its beginning "ERROR: In x.cxx, line 7\nvtkY (0x55d0): ".
  std::string text() const;
  bool empty() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
