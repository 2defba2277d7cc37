"""The version of this package: that of the project. The revision of the service's contract that it was made for."""

VERSION = "0.1.0"
CONTRACT_REVISION = 2
