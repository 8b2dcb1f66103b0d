"""Does it reproduce published effects of lesions, stimulation and dopamine?"""
