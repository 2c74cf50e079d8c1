"""A body that answers late: how late, what it holds back where axes turn, what takes its tip off."""
