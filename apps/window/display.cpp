#include "apps/window/display.hpp"

#include <X11/Xlib.h>

#include "io/error.hpp"

namespace dimple {

void require_display() {
  // Kept open: a server such as Xvfb starts anew when its last client leaves, and refuses the next one for a moment.
  static ::Display* display = nullptr;
  if (!display) display = XOpenDisplay(nullptr);
  if (!display)
    throw UsageError({.fact = "no window can be opened",
                      .where = "the display",
                      .why = "DISPLAY names no X server that answers",
                      .remedy = "start it where windows are shown, or under xvfb-run; results open in report.html, and `dimple poke --script` moves a tool without a window"});
}

}  // namespace dimple
