#pragma once

// What VTK says of files; used by vtk_files.cpp and vtk_read.cpp, by nobody else.

#include <vtkLogger.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkSmartPointer.h>

#include <mutex>
#include <string>
#include <string_view>

namespace dimple {

/// Keeps what VTK would print to the terminal. An observer on the reader is not enough: the parser and the
/// decompressor inside it report on their own.
class CapturedMessages : public vtkOutputWindow {
 public:
  static CapturedMessages* New() { VTK_STANDARD_NEW_BODY(CapturedMessages); }
  void DisplayText(const char* text) override {
    if (first.empty() && text != nullptr) first = text;
  }
  std::string first;  ///< the first message: later ones are its consequences

 protected:
  CapturedMessages() = default;
};

/// Captures VTK's messages for as long as it lives, then puts the former window back.
/// VTK's logger writes to the terminal beside the window, so it is silenced too.
class MessageScope {
 public:
  MessageScope() {
    vtkOutputWindow::SetInstance(window_);
    vtkObject::GlobalWarningDisplayOn();
    vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
  }
  ~MessageScope() {
    vtkLogger::SetStderrVerbosity(logged_);
    vtkObject::SetGlobalWarningDisplay(displayed_);
    vtkOutputWindow::SetInstance(before_);
  }
  MessageScope(const MessageScope&) = delete;
  MessageScope& operator=(const MessageScope&) = delete;

  /// The first message in one line, without its beginning "ERROR: In x.cxx, line 7\nvtkY (0x55d0): ".
  std::string text() const {
    std::string_view message = window_->first;
    if (const auto end = message.find("): "); end != std::string_view::npos) message.remove_prefix(end + 3);
    std::string line;
    for (const char c : message) {
      const bool blank = c == ' ' || c == '\n' || c == '\t' || c == '\r';
      if (!blank) line += c;
      if (blank && !line.empty() && line.back() != ' ') line += ' ';
    }
    while (!line.empty() && (line.back() == ' ' || line.back() == '.')) line.pop_back();
    return line;
  }
  bool empty() const { return window_->first.empty(); }

 private:
  // The window is the process's: who reads or writes beside this one waits.
  inline static std::recursive_mutex one_;
  std::lock_guard<std::recursive_mutex> alone_{one_};
  vtkNew<CapturedMessages> window_;
  vtkSmartPointer<vtkOutputWindow> before_ = vtkOutputWindow::GetInstance();
  int displayed_ = vtkObject::GetGlobalWarningDisplay();
  vtkLogger::Verbosity logged_ = vtkLogger::GetCurrentVerbosityCutoff();
};

}  // namespace dimple
