// Candidate motions of the nodes: the motion of points is projected to time t and votes at the nodes where it lands.
#include "rounding.h"

namespace {

// Sums over the votes for a candidate.
struct VoteSums {
  float dx, dy;
  float sure, ax, ay, squared_acceleration;  // of votes whose acceleration is known
  float gradients[4];                        // of dx and dy along x, then along y
};

struct Motion {  // of a candidate
  float dx, dy, ax, ay;
  float gradients[4];
};

static_assert(sizeof(VoteSums) == SUMS_PER_CANDIDATE * sizeof(float) &&
                  sizeof(Motion) == VALUES_PER_MOTION * sizeof(float),
              "as in the arrays of kernels/candidates.py");

// What is listed of a node so far, and the sums of all nodes in the order in which they were found.
struct NodeVotes {
  int32_t *listed;
  float *votes;
  int32_t *places;
  VoteSums *sums;

  NodeVotes(const CollectedVotes &all, Int row, Int column) : sums((VoteSums *)all.sums.data) {
    const Int node = row * all.listed.shape[1] + column, capacity = all.votes.shape[2];
    listed = (int32_t *)all.listed.data + node;
    votes = (float *)all.votes.data + node * capacity;
    places = (int32_t *)all.places.data + node * capacity;
  }
  VoteSums &of(Int k) const { return sums[places[k]]; }
};

// Part of an axis, relative to the frame corner.
struct Span {
  float first, last;
};

// From where to where, along an axis, what moves like this is within both frames; `t` is the distance from this one.
INLINE Span overlap_span(float motion, float t, Int size) {
  const float first = most(0.0f, most((t - 1) * motion, t * motion));
  const float last = float(size) - most(0.0f, most((1 - t) * motion, -t * motion));
  return {first, most(last, first)};
}

struct Nodes {
  Int first, last;
};

// The nodes in whose support a motion lands; beyond what both frames see, all are as the outermost.
//
// What moves in from outside, or out, is seen by one frame alone, and no motion is found for it: it is likely to move
// as what is next to it.
INLINE Nodes nodes_within(float landing, float support, const Span &seen, Int spacing, Int count) {
  const float middle = 0.5f * float(spacing), per_cell = 1 / float(spacing);
  Nodes nodes{0, count - 1};
  if (landing - support > seen.first)
    nodes.first = most(whole(__builtin_ceilf((landing - middle - support) * per_cell)), Int(0));
  if (landing + support < seen.last)
    nodes.last = least(whole(__builtin_floorf((landing - middle + support) * per_cell)), count - 1);
  return nodes;
}

// Adds a vote to the first candidate of a node whose mean is near, or to a new one as long as there is room.
INLINE void add_vote(const NodeVotes &node, const CollectedVotes &all, float tolerance, float vote, float sign,
                     const Motion &motion, float certainty) {
  const Int listed = *node.listed;
  Int k = 0;
  for (; k < listed; k++) {
    const float share = node.votes[k];
    const VoteSums &its = node.of(k);
    if (most(absolute(its.dy - motion.dy * share), absolute(its.dx - motion.dx * share)) < tolerance * share) break;
  }
  if (k == all.votes.shape[2]) return;
  if (k == listed) {
    Int &total = *(Int *)all.total.data;
    ++*node.listed;
    node.votes[k] = 0;
    node.places[k] = int32_t(total);
    node.sums[total] = {};
    ++total;
  }
  node.votes[k] += vote;
  VoteSums &its = node.of(k);
  its.dx += vote * motion.dx;
  its.dy += vote * motion.dy;
  const float turned = sign * vote, sure = vote * certainty;
  for (int n = 0; n < 4; n++) its.gradients[n] += turned * motion.gradients[n];
  its.sure += sure;
  its.ax += sure * motion.ax;
  its.ay += sure * motion.ay;
  its.squared_acceleration += sure * (motion.ax * motion.ax + motion.ay * motion.ay);
}

// The candidate with the most votes of those that come after `last`, the first of several; -1 stands for the beginning.
INLINE Int next_by_votes(const float *votes, Int count, Int last) {
  Int best = -1;
  for (Int k = 0; k < count; k++) {
    const bool waits = last < 0 || votes[k] < votes[last] || (votes[k] == votes[last] && k > last);
    if (waits && (best < 0 || votes[k] > votes[best])) best = k;
  }
  return best < 0 ? 0 : best;  // votes that are not numbers have no order
}

// The mean acceleration of a candidate, as far as its votes agree on it.
INLINE void set_acceleration(const VoteSums &its, float vote, float tolerance, Motion &motion) {
  motion.ax = motion.ay = 0;
  if (!(its.sure > 0)) return;
  const float sure = its.sure, ax = its.ax / sure, ay = its.ay / sure;
  const float variance = most(0.0f, its.squared_acceleration / sure - ax * ax - ay * ay);
  const float squared = tolerance * tolerance;
  float belief = sure / (sure + UNKNOWN * vote) * tolerance * tolerance / (squared + variance);
  // zero motion has no acceleration: a frozen frame stays unchanged
  belief *= least(1.0f, 4 * (absolute(motion.dx) + absolute(motion.dy)));
  motion.ax = belief * ax;
  motion.ay = belief * ay;
}

}  // namespace

KERNEL(void, collect_candidates, CollectCandidates) {
  const View<const float, 3> vectors(a.points.vectors), accelerations(a.points.accelerations);
  const View<const float, 4> gradients(a.points.gradients);
  const View<const float, 2> trust(a.points.trust);
  const CollectedVotes &all = a.collected;
  const Int rows = all.listed.shape[0], columns = all.listed.shape[1], spacing = all.spacing, step = a.step;
  const float sign = float(a.sign), t = float(a.t), support = float(a.support), tolerance = float(a.tolerance);
  const float middle = 0.5f * float(spacing), curve = t * (1 - t) * 0.5f;
  for (Int i = 0; i < vectors.shape[0]; i++) {
    const float y = float(least(i * step + step / 2, a.height - 1)) + 0.5f;  // relative to the frame corner
    for (Int j = 0; j < vectors.shape[1]; j++) {
      const float x = float(least(j * step + step / 2, a.width - 1)) + 0.5f;
      const float *vector = vectors.at(i, j), *change = accelerations.at(i, j), *gradient = gradients.at(i, j);
      Motion motion{0, 0, change[1], change[2], {gradient[0], gradient[1], gradient[2], gradient[3]}};
      const float landing_x = x + t * vector[0] - curve * motion.ax, landing_y = y + t * vector[1] - curve * motion.ay;
      const Span down_seen = overlap_span(vector[1], t, a.height), across_seen = overlap_span(vector[0], t, a.width);
      const Nodes down_nodes = nodes_within(landing_y, support, down_seen, spacing, rows);
      const Nodes across_nodes = nodes_within(landing_x, support, across_seen, spacing, columns);
      for (Int row = down_nodes.first; row <= down_nodes.last; row++) {
        const float node_y = middle + float(row * spacing);
        const float down = 1 - absolute(landing_y - least(down_seen.last, most(down_seen.first, node_y))) / support;
        for (Int column = across_nodes.first; column <= across_nodes.last; column++) {
          const float node_x = middle + float(column * spacing);
          const float nearest_x = least(across_seen.last, most(across_seen.first, node_x));
          const float across = 1 - absolute(landing_x - nearest_x) / support;
          const float vote = trust(i, j) * down * across;
          if (vote <= 0) continue;
          // extrapolate zoom and rotation to the node
          const float apart_x = node_x - landing_x, apart_y = node_y - landing_y;
          motion.dx = sign * (vector[0] + apart_x * gradient[0] + apart_y * gradient[2]);
          motion.dy = sign * (vector[1] + apart_x * gradient[1] + apart_y * gradient[3]);
          add_vote(NodeVotes(all, row, column), all, tolerance, vote, sign, motion, change[0]);
        }
      }
    }
  }
}

KERNEL(void, list_candidates, ListCandidates) {
  const View<int32_t, 2> listed_of(a.candidates.listed);
  const View<float, 3> weights_of(a.candidates.weights);
  const Int rows = listed_of.shape[0], columns = listed_of.shape[1], room = weights_of.shape[2];
  const float prior = float(a.zero_motion_prior), tolerance = float(a.acceleration_tolerance);
  const float min_share = float(a.min_share), min_weight = float(a.min_weight);
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++) {
      const NodeVotes node(a.collected, row, column);
      Motion *motions = (Motion *)a.candidates.motions.data + (row * columns + column) * room;
      float *weights = weights_of.at(row, column), all_votes = 0;
      const Int count = *node.listed, listed = least(count, room - 1);
      for (Int k = 0; k < count; k++) all_votes += node.votes[k];
      all_votes += prior;
      for (Int place = 0; place < room; place++) weights[place] = 0;
      for (Int place = 0, k = -1; place < listed; place++) {
        k = next_by_votes(node.votes, count, k);
        const VoteSums &its = node.of(k);
        const float vote = node.votes[k];
        Motion &motion = motions[place];
        motion.dx = its.dx / vote;
        motion.dy = its.dy / vote;
        for (int n = 0; n < 4; n++) motion.gradients[n] = its.gradients[n] / vote;
        set_acceleration(its, vote, tolerance, motion);
        weights[place] = vote / all_votes + min_share;
      }
      motions[listed] = {};
      weights[listed] = prior / all_votes + min_share;
      listed_of(row, column) = int32_t(listed + 1);
      float best = 0, total = 0;
      for (Int place = 0; place <= listed; place++) best = most(weights[place], best);
      for (Int place = 0; place <= listed; place++) {
        weights[place] = most(0.0f, weights[place] - min_weight * best);
        total += weights[place];
      }
      for (Int place = 0; place <= listed; place++) weights[place] /= total;
    }
}
