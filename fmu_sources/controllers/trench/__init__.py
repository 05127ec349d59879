"""What crosses trenches beside the control law (paper 003).

- `crossing`: lidar distances in; case, pitch reference and effective road out
- `pitch_reference`: a pitch that ramps up, holds and ramps down, with its preview
"""
