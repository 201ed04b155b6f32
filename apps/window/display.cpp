#include "apps/window/display.hpp"

#include <GL/glx.h>
#include <X11/Xlib.h>

#include <string>

#include "io/error.hpp"

namespace dimple {
namespace {

[[noreturn]] void no_window(const std::string& why, const std::string& remedy) {
  throw UsageError(
      {.fact = "no window can be opened",
       .where = "the display",
       .why = why,
       .remedy = remedy +
                 "; results open in report.html, and `dimple poke --script` moves a tool without a window"});
}

// Error handler that ignores the answer of a server without OpenGL, which would end the program.
int taken(::Display*, XErrorEvent*) {
  return 0;
}

// True if OpenGL 3.2 is available, which VTK requires: it calls abort() otherwise.
bool has_opengl(::Display* display) {
  int ignored = 0, count = 0;
  if (glXQueryExtension(display, &ignored, &ignored) == 0) return false;
  constexpr int seen[] = {GLX_DRAWABLE_TYPE, GLX_WINDOW_BIT, GLX_RENDER_TYPE, GLX_RGBA_BIT, None};
  GLXFBConfig* const configs = glXChooseFBConfig(display, DefaultScreen(display), seen, &count);
  const auto create = reinterpret_cast<PFNGLXCREATECONTEXTATTRIBSARBPROC>(
      glXGetProcAddressARB(reinterpret_cast<const GLubyte*>("glXCreateContextAttribsARB")));
  GLXContext context = nullptr;
  if (configs && count > 0 && create) {
    constexpr int version[] = {GLX_CONTEXT_MAJOR_VERSION_ARB, 3, GLX_CONTEXT_MINOR_VERSION_ARB, 2, None};
    const auto before = XSetErrorHandler(taken);
    context = create(display, configs[0], nullptr, True, version);
    XSync(display, False);
    XSetErrorHandler(before);
  }
  if (context) glXDestroyContext(display, context);
  if (configs) XFree(configs);
  return context != nullptr;
}

}  // namespace

void require_display() {
  // The connection stays open: a server such as Xvfb restarts when its last client leaves and then refuses
  // the next one for a moment.
  static ::Display* display = nullptr;
  if (!display) display = XOpenDisplay(nullptr);
  if (!display)
    no_window("DISPLAY names no X server that answers",
              "start it where windows are shown, or under xvfb-run");
  static const bool drawn = has_opengl(display);
  if (!drawn)
    no_window("the X server of DISPLAY draws no OpenGL 3.2 (its extension GLX is missing or too old)",
              "start it on a server with GLX, such as xvfb-run's own without further options");
}

}  // namespace dimple
