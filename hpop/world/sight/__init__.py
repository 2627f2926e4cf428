"""What a camera sees from a place: distances along bearings, landmarks, openness."""
