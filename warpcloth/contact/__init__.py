"""Contact: the stage at the end of each step that keeps cloth out of obstacles, and out of cloth."""

from .planes import ContactPlanes
from .stage import CONTACTS, ContactStage

__all__ = ["CONTACTS", "ContactPlanes", "ContactStage"]
