"""The world galoc is trained, stressed and scored in."""

from galoc_env.registration import ENV_ID, register

__all__ = ["ENV_ID", "register"]

register()
