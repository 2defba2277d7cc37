// The files that options name, checked before anything starts.
#pragma once

#include "absl/status/status.h"
#include "access/tls.h"
#include "options/options.h"

namespace voxelpipe {

TlsFiles TlsOf(const ServerOptions& options);

// What --web-listen needs of other options. INVALID_ARGUMENT naming the option.
absl::Status CheckWebOptions(const ServerOptions& options);

// Checks those, and that the files of --tls-... and --token-file can be read and are valid. Errors: one line naming the
// option.
absl::Status CheckFiles(const ServerOptions& options);

}  // namespace voxelpipe
