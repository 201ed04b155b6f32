#pragma once

namespace dimple {

/// Throws UsageError where no window can be opened: VTK would end the program.
void require_display();

}  // namespace dimple
