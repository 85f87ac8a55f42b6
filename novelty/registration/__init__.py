"""Registration: the given pose of the current scan, refined before the scans are compared."""

from novelty.registration.register import register
from novelty.registration.result import Registrations, RegistrationStatus
from novelty.registration.settings import Registration

__all__ = ["Registration", "RegistrationStatus", "Registrations", "register"]
