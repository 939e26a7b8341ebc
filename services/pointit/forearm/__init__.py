"""Yaw of a person's frame {H} from a marker body on the forearm, for all sources of such bodies."""
